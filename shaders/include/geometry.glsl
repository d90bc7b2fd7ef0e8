// geometry.glsl: instances of meshes. Baked meshes are instance 0, the identity; a scene without instances has no
// code for them.

#if CSM_INSTANCES

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
    vec4 p = vec4(position, 1.0);
    vec3 moved = vec3(dot(instances[instance].x, p), dot(instances[instance].y, p),
                      dot(instances[instance].z, p));
    return instance == 0u ? position : moved;
}

// Plane (unit normal, offset) of a triangle relative to the scene's origin.
vec4 origin_plane(uint instance, vec4 plane)
{
    // normals go with the cofactors of the linear part; a point of the plane goes with the whole
    instance_rows rows = instances[instance];
    mat3 linear = transpose(mat3(rows.x.xyz, rows.y.xyz, rows.z.xyz));
    mat3 cofactors = mat3(cross(linear[1], linear[2]), cross(linear[2], linear[0]),
                          cross(linear[0], linear[1]));
    vec3 n = normalize(cofactors * plane.xyz);
    vec4 moved = vec4(n, dot(n, origin_from_local(instance, plane.xyz * plane.w)));
    return instance == 0u ? plane : moved;
}

#else

vec3 origin_from_local(uint instance, vec3 position)
{
    return position;
}

vec4 origin_plane(uint instance, vec4 plane)
{
    return plane;
}

#endif
