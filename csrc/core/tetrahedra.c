/* tetrahedra.c: cuts convex bodies by planes, as tetrahedra.
 *
 * In: a slice of the view, planes. Out: pieces. A tetrahedron cut by a plane is one tetrahedron and
 * a prism, or two prisms, and a prism is three tetrahedra: no lists of faces, no memory, and what
 * is left of a slice after several windows, a body with holes, is still a list of simple pieces.
 */
#include "tetrahedra.h"

#include "linalg.h"

double tetrahedron_volume(const tetrahedron *t) {
    double edges[3][3], normal[3];
    for (int i = 0; i < 3; i++) {
        for (int axis = 0; axis < 3; axis++) {
            edges[i][axis] = t->corners[i + 1][axis] - t->corners[0][axis];
        }
    }
    vec3_cross(edges[0], edges[1], normal);
    return fabs(vec3_dot(normal, edges[2])) / 6.0;
}

void tetrahedron_centre(const tetrahedron *t, double out[3]) {
    for (int axis = 0; axis < 3; axis++) {
        out[axis] = 0.25 * (t->corners[0][axis] + t->corners[1][axis] + t->corners[2][axis] +
                            t->corners[3][axis]);
    }
}

static void set_corners(tetrahedron *t, const double *a, const double *b, const double *c,
                        const double *d) {
    const double *corners[4] = {a, b, c, d};
    for (int i = 0; i < 4; i++) {
        memcpy(t->corners[i], corners[i], sizeof t->corners[i]);
    }
}

/* A prism whose edges lead from p[i] to q[i]. */
static void set_prism(tetrahedron out[3], const double *const p[3], const double *const q[3]) {
    set_corners(&out[0], p[0], p[1], p[2], q[0]);
    set_corners(&out[1], p[1], p[2], q[0], q[1]);
    set_corners(&out[2], p[2], q[0], q[1], q[2]);
}

void tetrahedron_split(const tetrahedron *t, const double plane[4], tetrahedron_cut *out) {
    double height[4];
    int order[4], above = 0, below = 0;
    for (int i = 0; i < 4; i++) {
        height[i] = vec3_dot(plane, t->corners[i]) + plane[3];
        if (height[i] >= 0.0) {
            order[above++] = i;
        } else {
            order[3 - below++] = i;
        }
    }
    out->inside_count = out->outside_count = 0;
    if (above == 4) {
        out->inside[out->inside_count++] = *t;
        return;
    }
    if (above == 0) {
        out->outside[out->outside_count++] = *t;
        return;
    }
    const double *p[4];
    double cuts[4][4][3];
    for (int i = 0; i < 4; i++) {
        p[i] = t->corners[order[i]];
    }
    for (int i = 0; i < above; i++) {
        for (int j = above; j < 4; j++) {
            const double share = height[order[i]] / (height[order[i]] - height[order[j]]);
            for (int axis = 0; axis < 3; axis++) {
                cuts[i][j][axis] = p[i][axis] + (p[j][axis] - p[i][axis]) * share;
            }
        }
    }
    out->inside_count = above == 1 ? 1 : 3;
    out->outside_count = above == 3 ? 1 : 3;
    if (above == 1) {
        set_corners(&out->inside[0], p[0], cuts[0][1], cuts[0][2], cuts[0][3]);
        set_prism(out->outside, (const double *const[3]){cuts[0][1], cuts[0][2], cuts[0][3]},
                  (const double *const[3]){p[1], p[2], p[3]});
    } else if (above == 3) {
        set_corners(&out->outside[0], p[3], cuts[0][3], cuts[1][3], cuts[2][3]);
        set_prism(out->inside, (const double *const[3]){cuts[0][3], cuts[1][3], cuts[2][3]},
                  (const double *const[3]){p[0], p[1], p[2]});
    } else {
        set_prism(out->inside, (const double *const[3]){p[0], cuts[0][2], cuts[0][3]},
                  (const double *const[3]){p[1], cuts[1][2], cuts[1][3]});
        set_prism(out->outside, (const double *const[3]){p[2], cuts[0][2], cuts[1][2]},
                  (const double *const[3]){p[3], cuts[0][3], cuts[1][3]});
    }
}

void tetrahedron_clip(const tetrahedron *t, const double (*planes)[4], int count,
                      tetrahedron_visit visit, void *user) {
    if (count == 0) {
        visit(user, t);
        return;
    }
    tetrahedron_cut cut;
    tetrahedron_split(t, planes[0], &cut);
    for (int i = 0; i < cut.inside_count; i++) {
        tetrahedron_clip(&cut.inside[i], planes + 1, count - 1, visit, user);
    }
}

void tetrahedra_of_slice(const double corners[CSM_CORNER_COUNT][3], tetrahedron out[6]) {
    /* From the left bottom near corner, the two triangles of each face that does not hold it. */
    static const int opposite[6][3] = {{CSM_RTF, CSM_LBF, CSM_LTF}, {CSM_RTF, CSM_LTF, CSM_LTN},
                                       {CSM_RTF, CSM_LTN, CSM_RTN}, {CSM_RTF, CSM_RTN, CSM_RBN},
                                       {CSM_RTF, CSM_RBN, CSM_RBF}, {CSM_RTF, CSM_RBF, CSM_LBF}};
    for (int i = 0; i < 6; i++) {
        set_corners(&out[i], corners[CSM_LBN], corners[opposite[i][0]], corners[opposite[i][1]],
                    corners[opposite[i][2]]);
    }
}
