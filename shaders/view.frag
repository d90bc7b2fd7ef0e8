// view.frag: which triangle of which instance is seen.

layout(location = 0) flat in uvec2 record;

layout(location = 0) out uvec2 ids;

void main()
{
    ids = uvec2(record.x + uint(gl_PrimitiveID), record.y);
}
