// view_column.glsl: walking down a column of the view, for passes that sum up what is seen. Everything that does not
// change from row to row is taken out of the loop by hand: on software GL that halves its cost. Needs
// view_receiver.glsl.

const int run_length = 32; // CSM_RECEIVER_RUN

// Rays of a column: a ray at ndc y has start0 + y * start1 and direction0 + y * direction1.
struct view_column
{
    int column, first, last; // rows first <= row < last
    vec3 start0, start1, direction0, direction1;
    vec3 eye_high, eye_low, to_light;
    vec2 ends;
    float ndc_step;
};

// The run of this invocation; neighbours in a group read neighbouring pixels. Empty beyond the picture.
view_column column_of_invocation()
{
    view_column run;
    int index = int(gl_GlobalInvocationID.x);
    run.column = index % frame.image.x;
    run.first = index / frame.image.x * run_length;
    run.last = min(run.first + run_length, frame.image.y);
    float ndc_x = (float(run.column) + 0.5) / float(frame.image.x) * 2.0 - 1.0;
    vec3 across = (frame.view_centre.x + ndc_x * frame.view.x) * frame.right.xyz +
                  frame.view_centre.y * frame.up.xyz;
    vec3 upwards = frame.view.y * frame.up.xyz;
    bool orthographic = frame.right.w > 0.0;
    run.start0 = orthographic ? across : vec3(0.0);
    run.start1 = orthographic ? upwards : vec3(0.0);
    run.direction0 = orthographic ? -frame.backward.xyz : across - frame.backward.xyz;
    run.direction1 = orthographic ? vec3(0.0) : upwards;
    run.eye_high = frame.eye_high.xyz;
    run.eye_low = frame.eye_low.xyz;
    run.to_light = frame.to_light.xyz;
    run.ends = frame.view.zw;
    run.ndc_step = 2.0 / float(frame.image.y);
    return run;
}

float ndc_of_row(view_column run, int row)
{
    return (float(row) + 0.5) * run.ndc_step - 1.0;
}

// View depth of a row's surface; counts is false unless there is one that faces the sun.
float depth_of_row(view_column run, int row, out bool counts)
{
    bool seen;
    vec4 plane = plane_at(ivec2(run.column, row), seen);
    float ndc_y = ndc_of_row(run, row);
    vec3 direction = run.direction0 + ndc_y * run.direction1;
    float facing = dot(plane.xyz, run.to_light);
    counts = seen && (dot(plane.xyz, direction) > 0.0 ? -facing : facing) > facing_limit;
    return depth_on_plane(plane, run.eye_high, run.eye_low, run.start0 + ndc_y * run.start1, direction, run.ends);
}
