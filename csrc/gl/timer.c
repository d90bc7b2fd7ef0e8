/* timer.c: milliseconds per pass. Timer queries on hardware; on software GL they are useless (0.000
 * and 30 ms were seen for the same pass), so there the wall clock runs around glFinish.
 *
 * Each pass that is timed is waited for. Read at the frame's end, queries on an H200 also counted
 * how long the GPU waited for the host: passes of 5.1 ms as 9.6, median of 29 frames.
 */
#include "gl_internal.h"

#include <time.h>

double csm_clock_ms(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return 1e3 * (double)now.tv_sec + 1e-6 * (double)now.tv_nsec;
}

void csm_timer_start(const csm_frame *frame) {
    csm_renderer *renderer = frame->renderer;
    csm_timer *timer = &renderer->timer;
    if (frame->desc->untimed) {
        return;
    }
    if (timer->queries) {
        renderer->gl.BeginQuery(GL_TIME_ELAPSED, timer->query);
    } else {
        renderer->gl.Finish();
        timer->start_ms = csm_clock_ms();
    }
}

void csm_timer_stop(const csm_frame *frame, const char *name) {
    csm_renderer *renderer = frame->renderer;
    csm_render_out *out = frame->out;
    csm_timer *timer = &renderer->timer;
    double elapsed_ms;
    if (frame->desc->untimed) {
        return;
    }
    if (timer->queries) {
        GLuint64 nanoseconds = 0;
        renderer->gl.EndQuery(GL_TIME_ELAPSED);
        renderer->gl.GetQueryObjectui64v(timer->query, GL_QUERY_RESULT, &nanoseconds);
        elapsed_ms = 1e-6 * (double)nanoseconds;
    } else {
        renderer->gl.Finish();
        elapsed_ms = csm_clock_ms() - timer->start_ms;
    }
    if (out->timing_count < CSM_MAX_TIMINGS) {
        out->timing_names[out->timing_count] = name;
        out->timing_ms[out->timing_count++] = elapsed_ms;
    }
}
