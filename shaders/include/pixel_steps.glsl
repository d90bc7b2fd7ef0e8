// pixel_steps.glsl: how far the receiver moves in light space from one pixel to the next (docs/numerics.md 29);
// included by view_receiver.glsl. Light space is the same for all cascades, so that nothing of it jumps at their seams.

#if CSM_STEPS == CSM_STEPS_ANALYTIC || CSM_STEPS == CSM_STEPS_BOTH

// A plane that is edge-on to the camera runs on for ever.
const float least_towards = 1e-6;

// The derivative of the ray's end on the plane, where across is that of its direction, or of its start if rays are
// parallel.
vec3 step_on_plane(vec4 plane, view_ray ray, vec3 across)
{
    float towards = dot(plane.xyz, ray.direction);
    towards = abs(towards) > least_towards ? towards : (towards < 0.0 ? -least_towards : least_towards);
    float reach = frame.right.w > 0.0 ? 1.0 : plane_depth(plane, ray);
    return light_position(reach * (across - ray.direction * (dot(plane.xyz, across) / towards)));
}

#endif

#if CSM_STEPS == CSM_STEPS_DIFFERENCES || CSM_STEPS == CSM_STEPS_BOTH

neighbour on_plane(vec4 plane, ivec2 pixel, bool seen)
{
    view_ray ray = ray_through(pixel);
    float depth = plane_depth(plane, ray);
    vec3 away = frame.eye_low.xyz + ray.start + depth * ray.direction;
    return neighbour(frame.eye_high.xyz + away, away, towards_camera(plane, ray), depth, seen);
}

// Beyond an odd rim of the picture the surface at the rim goes on, where nothing is seen the pixel's own.
neighbour neighbour_at(ivec2 pixel, vec4 own)
{
    bool seen;
    vec4 plane = plane_at(min(pixel, frame.image.xy - 1), seen);
    return on_plane(seen ? plane : own, pixel, seen);
}

#endif

void take_steps(inout receiver point, ivec2 pixel, vec4 plane, bool seen)
{
#if CSM_STEPS == CSM_STEPS_ANALYTIC || CSM_STEPS == CSM_STEPS_BOTH
    view_ray ray = ray_through(pixel);
    vec3 on_plane_x = step_on_plane(plane, ray, frame.right.xyz * (2.0 * frame.view.x / float(frame.image.x)));
    vec3 on_plane_y = step_on_plane(plane, ray, frame.up.xyz * (2.0 * frame.view.y / float(frame.image.y)));
#endif
#if CSM_STEPS == CSM_STEPS_ANALYTIC
    point.step_x = on_plane_x;
    point.step_y = on_plane_y;
#elif CSM_STEPS == CSM_STEPS_BOTH
    point.plane_step_x = on_plane_x;
    point.plane_step_y = on_plane_y;
#endif
#if CSM_STEPS == CSM_STEPS_DIFFERENCES || CSM_STEPS == CSM_STEPS_BOTH
    // quads start at even pixels; with these neighbours, differences are what a fragment's fine derivatives would be
    // but for their signs, and compute has them too
    point.own = on_plane(plane, pixel, seen);
    point.beside = neighbour_at(pixel ^ ivec2(1, 0), plane);
    point.above = neighbour_at(pixel ^ ivec2(0, 1), plane);
    point.across = neighbour_at(pixel ^ 1, plane);
    point.step_x = light_position(point.beside.away - point.own.away);
    point.step_y = light_position(point.above.away - point.own.away);
#endif
}
