/* runs.h: points in the order of view depth. */
#ifndef CSM_RUNS_H
#define CSM_RUNS_H

#include <stdbool.h>
#include <stddef.h>

/* The first of ascending depths from begin on that is beyond a depth, or, with its own, not before
 * it; end if there is none. */
static inline size_t first_beyond(const double *depths, size_t begin, size_t end, double depth,
                                  bool or_at) {
    while (begin < end) {
        const size_t middle = begin + (end - begin) / 2;
        if (depths[middle] > depth || (or_at && depths[middle] == depth)) {
            end = middle;
        } else {
            begin = middle + 1;
        }
    }
    return begin;
}

#endif
