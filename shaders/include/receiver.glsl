// receiver.glsl: a point whose visibility is asked for, as the filters see it.

struct receiver
{
    vec3 position;  // relative to the scene's origin
    vec3 normal;    // towards the camera; zero if unknown
    float view_depth;
    float noise;    // its lot, 0 to 1
#if CSM_TEXCOORD == CSM_TEXCOORD_INTERPOLATED
    vec3 position_ls; // in light space, interpolated between vertices
#endif
};

const int no_cascade = 255;
const float facing_limit = 1e-5; // an edge-on wall is not decided by rounding

bool plane_known(receiver point)
{
    return point.normal != vec3(0.0);
}

// A receiver in the window of the cascade that answers for it. Filters read this and no per-cascade uniform: an
// index that is only known at run time costs a gather for every number on software GL.
struct map_receiver
{
    int cascade;
    int size;       // texels along a side of the map
    ivec2 texel;    // that holds the point
    vec2 fraction;  // where in the texel, 0 to 1
    float z;        // depth, bias subtracted
    vec2 slope;     // change of depth per texel on the receiver's plane; zero unless receiver_plane
    vec2 level;     // the same at one distance from the light; zero unless warped
    vec2 density;   // texels per metre along u, v
    float scale;    // depth per metre
    float noise;    // of the receiver
    float view_depth;
};
