/* debug.c: driver messages into a fixed ring, labels and groups for people with a GL debugger.
 *
 * The callback runs inside the offending call, without Python's lock: it only copies. An error or a
 * message of high severity fails the call at the next check.
 */
#include "gl_internal.h"

#include <stdio.h>
#include <string.h>

static void GLAD_API_PTR on_message(GLenum source, GLenum type, GLuint id, GLenum severity,
                                    GLsizei length, const GLchar *text, const void *user) {
    (void)source;
    (void)length;
    csm_message_ring *ring = (csm_message_ring *)user;
    if (type == GL_DEBUG_TYPE_PUSH_GROUP || type == GL_DEBUG_TYPE_POP_GROUP) {
        return; /* our own groups come back as notifications */
    }
    if (type == GL_DEBUG_TYPE_ERROR || severity == GL_DEBUG_SEVERITY_HIGH) {
        if (!ring->failed) {
            snprintf(ring->error, sizeof ring->error, "%s", text);
        }
        ring->failed = true;
    }
    if (ring->count == CSM_RING_SIZE) {
        ring->first = (ring->first + 1) % CSM_RING_SIZE;
        ring->count--;
    }
    csm_message *message = &ring->messages[(ring->first + ring->count++) % CSM_RING_SIZE];
    message->id = id;
    message->severity = severity;
    snprintf(message->text, sizeof message->text, "%s", text);
}

void csm_debug_start(csm_renderer *renderer) {
    const GladGLContext *gl = &renderer->gl;
    if (!renderer->debug) {
        return;
    }
    gl->Enable(GL_DEBUG_OUTPUT);
    gl->Enable(GL_DEBUG_OUTPUT_SYNCHRONOUS);
    gl->DebugMessageCallback(on_message, &renderer->ring);
}

void csm_debug_label(csm_renderer *renderer, GLenum kind, GLuint name, const char *label) {
    if (renderer->debug) {
        renderer->gl.ObjectLabel(kind, name, -1, label);
    }
}

void csm_debug_push(csm_renderer *renderer, const char *pass) {
    if (renderer->debug) {
        renderer->gl.PushDebugGroup(GL_DEBUG_SOURCE_APPLICATION, 0, -1, pass);
    }
}

void csm_debug_pop(csm_renderer *renderer) {
    if (renderer->debug) {
        renderer->gl.PopDebugGroup();
    }
}

/* More error flags than a driver has; one that has lost its device would report for ever. */
#define MAX_ERROR_FLAGS 16

csm_status csm_debug_check(csm_renderer *renderer, const char *pass, csm_error *err) {
    GLenum code = renderer->gl.GetError();
    bool told = renderer->ring.failed;
    renderer->ring.failed = false;
    for (int i = 0; i < MAX_ERROR_FLAGS && code != GL_NO_ERROR; i++) {
        if (renderer->gl.GetError() == GL_NO_ERROR) {
            break; /* what is left standing would fail the next check, of another call */
        }
    }
    if (code == GL_OUT_OF_MEMORY) {
        return csm_fail(err, CSM_ERROR_OUT_OF_MEMORY, "%s: the driver is out of memory%s%s", pass,
                        told ? ": " : "", told ? renderer->ring.error : "");
    }
    if (told) {
        return csm_fail(err, CSM_ERROR_GL, "%s: %s", pass, renderer->ring.error);
    }
    if (code != GL_NO_ERROR) {
        return csm_fail(err, CSM_ERROR_GL,
                        "%s: OpenGL error 0x%04x (Renderer(debug=True) tells more)", pass, code);
    }
    return CSM_OK;
}

static const char *severity_name(GLenum severity) {
    switch (severity) {
    case GL_DEBUG_SEVERITY_HIGH:
        return "high";
    case GL_DEBUG_SEVERITY_MEDIUM:
        return "medium";
    case GL_DEBUG_SEVERITY_LOW:
        return "low";
    default:
        return "notification";
    }
}

void csm_renderer_drain_messages(csm_renderer *renderer, csm_message_callback callback,
                                 void *user) {
    csm_message_ring *ring = &renderer->ring;
    if (pthread_mutex_lock(&renderer->lock)) {
        return;
    }
    while (ring->count) {
        const csm_message *message = &ring->messages[ring->first];
        ring->first = (ring->first + 1) % CSM_RING_SIZE;
        ring->count--;
        callback(user, message->id, severity_name(message->severity), message->text);
    }
    pthread_mutex_unlock(&renderer->lock);
}
