/* Solutions within the limits, one pose or many, whatever finds the postures. */
#include "core.h"

#include "calibrated.h"
#include "chain.h"

#include <math.h>
#include <string.h>

enum { MOST = 16 };                                   /* postures of an arm with finitely many */
static const double FARTHEST = 1e6;                   /* of a seed's entries [rad] */

static int postures(enum kr_way way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
                    double tol, double *rows, int *miss) {
    static const double zero[KR_MAX_JOINTS] = {0.0};
    if (!seed) seed = zero;
    switch (way) {
        case KR_UR: return kr_ur_postures(prepared, arm, T, seed, tol, rows, miss);
        case KR_CALIBRATED: return kr_calibrated_postures(prepared, T, tol, rows, miss);
    }
    *miss = 0;
    return 0;
}

int kr_solutions(enum kr_way way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
                 int limits, double tol, double *rows, int found[2]) {
    int miss;
    if (!kr_is_rigid(T)) return -1;
    const int count = postures(way, prepared, limits ? arm : NULL, T, seed, tol, rows, &miss);
    if (found) found[0] = count, found[1] = miss;
    return kr_within(arm, 0, T, seed, limits, tol, rows, count);
}

int kr_nearest(enum kr_way way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
               double tol, double *rows) {
    for (int j = 0; j < arm->n; j++)
        if (!(fabs(seed[j]) <= FARTHEST)) return -1;
    const int kept = kr_solutions(way, prepared, arm, T, seed, 1, tol, rows, NULL);
    if (kept > 0) kr_errors(arm, 0, T, rows, 1, rows + arm->n + 2);
    return kept;
}

int kr_solutions_of_each(enum kr_way way, const void *prepared, const kr_arm *arm, const double *T, int count, int limits,
                         double tol, int branches, double *q, unsigned char *valid) {
    const int n = arm->n;
    double rows[MOST * (KR_MAX_JOINTS + 2)];
    for (int i = 0; i < count; i++, T += 16, q += branches * n, valid += branches) {
        const int kept = kr_solutions(way, prepared, arm, T, NULL, limits, tol, rows, NULL);
        if (kept < 0) return i;
        memset(valid, 0, branches);
        for (int k = 0; k < branches * n; k++) q[k] = NAN;
        for (int k = 0; k < kept; k++) {
            const double *row = rows + (n + 2) * k;
            const int branch = (int)row[0];
            valid[branch] = 1;
            memcpy(q + n * branch, row + 2, n * sizeof *q);
        }
    }
    return -1;
}

int kr_nearest_of_each(enum kr_way way, const void *prepared, const kr_arm *arm, const double *T, const double *seeds,
                       int count, double tol, double *q, long long *branch) {
    const int n = arm->n;
    double rows[MOST * (KR_MAX_JOINTS + 2)];
    for (int i = 0; i < count; i++, T += 16, seeds += n, q += n) {
        const int kept = kr_solutions(way, prepared, arm, T, seeds, 1, tol, rows, NULL);
        if (kept < 0) return i;
        branch[i] = kept ? (long long)rows[0] : -1;
        for (int j = 0; j < n; j++) q[j] = kept ? rows[2 + j] : NAN;
    }
    return -1;
}
