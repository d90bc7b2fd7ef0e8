// view.frag: which triangle of which instance is seen. Without instances the target holds the triangle alone.

layout(location = 0) flat in uvec2 ids;

layout(location = 0) out uvec2 seen;

void main()
{
    seen = ids;
}
