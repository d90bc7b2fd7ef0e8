// geometry.glsl: instances of meshes; row 0 is the identity of everything that is baked.

struct instance_rows
{
    vec4 x, y, z; // rows of origin_from_local
};

layout(std430, binding = 0) readonly buffer instance_block
{
    instance_rows instances[];
};

vec3 origin_from_local(uint instance, vec3 position)
{
    if (instance == 0u) {
        return position;
    }
    vec4 p = vec4(position, 1.0);
    return vec3(dot(instances[instance].x, p), dot(instances[instance].y, p),
                dot(instances[instance].z, p));
}
