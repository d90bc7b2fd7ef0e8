// moments_lookup.glsl: filtered moments at a receiver.

layout(binding = 4) uniform sampler2DArray moments;

vec4 moments_at(map_receiver at, int slice, int slices)
{
    // texels beyond the rim are those at it: the layer may hold more than this map
    vec2 place = clamp(vec2(at.texel) + at.fraction, 0.5, float(at.size) - 0.5);
    vec2 uv = place / vec2(textureSize(moments, 0).xy);
    return textureLod(moments, vec3(uv, float(at.cascade * slices + slice)), 0.0);
}
