// receiver.glsl: a point whose visibility is asked for, as the filters see it.

#if CSM_STEPS == CSM_STEPS_DIFFERENCES || CSM_STEPS == CSM_STEPS_BOTH
// Another pixel of a pixel's quad.
struct neighbour
{
    vec3 position;
    vec3 away;    // from the eye, or all but: differences of it keep more digits than those of positions
    vec3 normal;
    float view_depth;
    bool seen;    // else the pixel's own plane goes on there
};
#endif

struct receiver
{
    vec3 position;  // relative to the scene's origin
    vec3 normal;    // towards the camera; zero if unknown
    float view_depth;
    float noise;    // its lot, 0 to 1
#if CSM_TEXCOORD == CSM_TEXCOORD_INTERPOLATED
    vec3 position_ls; // in light space, interpolated between vertices
#endif
#if CSM_STEPS != CSM_STEPS_NONE
    vec3 step_x, step_y; // in light space, to the next pixel; zero for points, which have none
#endif
#if CSM_STEPS == CSM_STEPS_BOTH
    vec3 plane_step_x, plane_step_y; // the same on the pixel's own plane, for footprints
#endif
#if CSM_STEPS == CSM_STEPS_DIFFERENCES || CSM_STEPS == CSM_STEPS_BOTH
    neighbour own, beside, above, across; // the quad: along x, along y, along both
#endif
};

const int no_cascade = 255;
const float facing_limit = 1e-5; // an edge-on wall is not decided by rounding

bool plane_known(receiver point)
{
    return point.normal != vec3(0.0);
}

// A point that is no pixel has no neighbours.
void stand_alone(inout receiver point)
{
#if CSM_STEPS != CSM_STEPS_NONE
    point.step_x = point.step_y = vec3(0.0);
#endif
#if CSM_STEPS == CSM_STEPS_BOTH
    point.plane_step_x = point.plane_step_y = vec3(0.0);
#endif
#if CSM_STEPS == CSM_STEPS_DIFFERENCES || CSM_STEPS == CSM_STEPS_BOTH
    point.own = neighbour(point.position, vec3(0.0), point.normal, point.view_depth, true);
    point.beside = point.above = point.across = point.own;
#endif
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
#if CSM_LOOKUP != CSM_LOOKUP_BILINEAR
    vec4 footprint; // of the pixel [texels]: step along x of the picture, then along y
#endif
};
