/* timer.c: milliseconds per pass. Timer queries on hardware; on software GL they are useless (0.000
 * and 30 ms were seen for the same pass), so there the wall clock runs around glFinish.
 *
 * A query is read when the whole frame is done: to wait for one would leave the GPU idle while the
 * next pass is prepared. The query of a pass is that of its place among the frame's timings, so
 * whatever a frame that failed leaves unread is written over by the next.
 */
#include "gl_internal.h"

#include <time.h>

double csm_clock_ms(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

void csm_timers_make(csm_renderer *renderer) {
    csm_timer *timer = &renderer->timer;
    timer->queries = !renderer->info.software;
    if (timer->queries) {
        renderer->gl.CreateQueries(GL_TIME_ELAPSED, CSM_MAX_TIMINGS, timer->names);
        renderer->info.live_objects += CSM_MAX_TIMINGS;
    }
}

void csm_timers_drop(csm_renderer *renderer) {
    if (renderer->timer.queries) {
        renderer->gl.DeleteQueries(CSM_MAX_TIMINGS, renderer->timer.names);
        renderer->info.live_objects -= CSM_MAX_TIMINGS;
        renderer->timer.queries = false;
    }
}

void csm_timer_start(csm_frame *frame) {
    const GladGLContext *gl = &frame->renderer->gl;
    csm_timer *timer = &frame->renderer->timer;
    const int next = frame->out->timing_count;
    if (!timer->queries) {
        gl->Finish();
        timer->start_ms = csm_clock_ms();
    } else if (next < CSM_MAX_TIMINGS) {
        gl->BeginQuery(GL_TIME_ELAPSED, timer->names[next]);
    }
}

void csm_timer_stop(csm_frame *frame, const char *name) {
    const GladGLContext *gl = &frame->renderer->gl;
    const csm_timer *timer = &frame->renderer->timer;
    if (!timer->queries) {
        gl->Finish();
        csm_timing_add(frame->out, name, csm_clock_ms() - timer->start_ms);
    } else if (frame->out->timing_count < CSM_MAX_TIMINGS) {
        gl->EndQuery(GL_TIME_ELAPSED);
        csm_timing_add(frame->out, name, 0.0); /* until csm_timers_read */
    }
}

void csm_timers_read(csm_frame *frame) {
    const csm_timer *timer = &frame->renderer->timer;
    for (int i = 0; timer->queries && i < frame->out->timing_count; i++) {
        GLuint64 nanoseconds = 0;
        frame->renderer->gl.GetQueryObjectui64v(timer->names[i], GL_QUERY_RESULT, &nanoseconds);
        frame->out->timing_ms[i] = 1e-6 * (double)nanoseconds;
    }
}

void csm_timing_add(csm_render_out *out, const char *name, double elapsed_ms) {
    if (out->timing_count < CSM_MAX_TIMINGS) {
        out->timing_names[out->timing_count] = name;
        out->timing_ms[out->timing_count++] = elapsed_ms;
    }
}
