/* status.c: statuses and the errors that carry them. */
#include "csm.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

static const struct {
    csm_status status;
    const char *name, *exception, *text;
} statuses[] = {
#define CSM_STATUS_ROW(id, value, exception, text) {CSM_##id, #id, exception, text},
    CSM_STATUS_TABLE(CSM_STATUS_ROW)
#undef CSM_STATUS_ROW
};

/* Statuses are 0, -1, -2, ... in the order of the table. */
static int row_of(csm_status status) {
    int row = -(int)status;
    int count = (int)(sizeof statuses / sizeof *statuses);
    return row >= 0 && row < count ? row : 1;
}

const char *csm_status_name(csm_status status) {
    return statuses[row_of(status)].name;
}

const char *csm_status_exception(csm_status status) {
    return statuses[row_of(status)].exception;
}

const char *csm_status_text(csm_status status) {
    return statuses[row_of(status)].text;
}

csm_status csm_fail(csm_error *err, csm_status status, const char *format, ...) {
    if (err) {
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(err->text, sizeof err->text, format, arguments);
        va_end(arguments);
        err->status = status;
    }
    return status;
}

void csm_fail_more(csm_error *err, const char *format, ...) {
    if (!err) {
        return;
    }
    size_t used = err->status == CSM_OK ? 0 : strlen(err->text);
    if (used && used + 1 < sizeof err->text) {
        err->text[used++] = '\n';
    }
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(err->text + used, sizeof err->text - used, format, arguments);
    va_end(arguments);
    err->status = CSM_ERROR_INVALID_ARGUMENT;
}
