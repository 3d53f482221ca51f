/* Solutions within the limits, one pose or many, whatever finds the postures. */
#include "core.h"

#include "calibrated.h"
#include "chain.h"
#include "elimination.h"
#include "rows.h"
#include "six_axis.h"

#include <math.h>
#include <string.h>

enum { MOST = 16 };                                   /* postures of an arm with finitely many */
enum { JOINTS = 6, WIDTH = JOINTS + 2 };              /* of the arms that are solved from either end */
enum { OTHERS = 24 };                                 /* values of free joints that are tried on half a turn */
static const double FARTHEST = 1e6;                   /* of a seed's entries [rad] */

static int postures(int way, const void *prepared, const kr_arm *arm, const double *T, const double *seed, double tol,
                    double *rows, int *miss) {
    *miss = 0;
    switch (way) {
        case KR_UR: return kr_ur_postures(prepared, arm, T, seed, tol, rows, miss);
        case KR_CALIBRATED: return kr_calibrated_postures(prepared, T, tol, rows, miss);
        case KR_DECOUPLED: return kr_decoupled_postures(prepared, T, seed, tol, rows);
        case KR_ELIMINATION: return kr_elimination_rows(prepared, T, tol, rows);
    }
    return 0;
}

/* The postures of an arm by those of the same arm from its tip to its base. */
static int backwards(int way, const void *prepared, const double T[16], const double *seed, double tol, double *rows,
                     int *miss) {
    double inverse[12], wanted[JOINTS];
    for (int r = 0; r < 3; r++) {
        for (int c = 0; c < 3; c++) inverse[4 * r + c] = T[4 * c + r];
        inverse[4 * r + 3] = -(T[r] * T[3] + T[4 + r] * T[7] + T[8 + r] * T[11]);
    }
    for (int j = 0; j < JOINTS; j++) wanted[j] = -seed[JOINTS - 1 - j];
    const int count = postures(way, prepared, NULL, inverse, wanted, tol, rows, miss);
    for (int i = 0; i < count; i++) {
        double *q = rows + (JOINTS + 2) * i + 2;
        for (int j = 0; j < JOINTS / 2; j++) {
            const double first = q[j];
            q[j] = -q[JOINTS - 1 - j], q[JOINTS - 1 - j] = -first;
        }
    }
    return count;
}

static int either_way(int way, const void *prepared, const kr_arm *arm, const double *T, const double *seed, double tol,
                      double *rows, int *miss) {
    if (way & KR_BACKWARDS) return backwards(way & ~KR_BACKWARDS, prepared, T, seed, tol, rows, miss);
    return postures(way, prepared, arm, T, seed, tol, rows, miss);
}

/* Replace postures that the limits forbid: free joints take other values than the seed's, the nearest first. */
static void free_joints_within(int way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
                               double tol, double *rows, int count) {
    double other[WIDTH * MOST], found[JOINTS], start[JOINTS];
    int open = 0, flags = 0, miss;
    for (int i = 0; i < count; i++) {
        flags |= rows[WIDTH * i + 1] != 0.0;
        if (!kr_allowed(arm, 0, T, rows + WIDTH * i + 2, seed, 1, tol, found)) open |= 1 << i;
    }
    for (int step = 1; step < 2 * OTHERS && open && flags; step++) {
        const double turn = KR_PI / OTHERS * (step % 2 ? -(step + 1) / 2 : step / 2);
        for (int j = 0; j < JOINTS; j++) start[j] = seed[j] + turn;
        const int others = either_way(way, prepared, NULL, T, start, tol, other, &miss);
        for (int k = 0; k < others; k++)
            for (int i = 0; i < count; i++)
                if ((open >> i & 1) && rows[WIDTH * i] == other[WIDTH * k] &&
                    kr_allowed(arm, 0, T, other + WIDTH * k + 2, seed, 1, tol, found)) {
                    memcpy(rows + WIDTH * i, other + WIDTH * k, WIDTH * sizeof *rows);
                    open &= ~(1 << i);
                }
    }
}

int kr_solutions(int way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
                 int limits, double tol, double *rows) {
    static const double zero[KR_MAX_JOINTS] = {0.0};
    const double *wanted = seed ? seed : zero;
    int miss;
    if (!kr_is_rigid(T)) return -1;
    const int count = either_way(way, prepared, limits ? arm : NULL, T, wanted, tol, rows, &miss);
    if (limits && !arm->full_turn && (way & ~KR_BACKWARDS) == KR_DECOUPLED)
        free_joints_within(way, prepared, arm, T, wanted, tol, rows, count);
    const int kept = kr_within(arm, 0, T, seed, limits, tol, rows, count);
    if (!kept) rows[0] = count, rows[1] = miss;
    return kept;
}

int kr_nearest(int way, const void *prepared, const kr_arm *arm, const double T[16], const double *seed,
               double tol, double *rows) {
    for (int j = 0; j < arm->n; j++)
        if (!(fabs(seed[j]) <= FARTHEST)) return -1;
    const int kept = kr_solutions(way, prepared, arm, T, seed, 1, tol, rows);
    if (kept > 0) kr_errors(arm, 0, T, rows, 1, rows + arm->n + 2);
    return kept;
}

int kr_solutions_of_each(int way, const void *prepared, const kr_arm *arm, const double *T, int count, int limits,
                         double tol, int branches, double *q, unsigned char *valid) {
    const int n = arm->n;
    double rows[MOST * (KR_MAX_JOINTS + 2)];
    for (int i = 0; i < count; i++, T += 16, q += branches * n, valid += branches) {
        const int kept = kr_solutions(way, prepared, arm, T, NULL, limits, tol, rows);
        if (kept < 0) return i;
        kr_by_branch(n, branches, rows, kept, q, valid);
    }
    return -1;
}

int kr_nearest_of_each(int way, const void *prepared, const kr_arm *arm, const double *T, const double *seeds,
                       int count, double tol, double *q, long long *branch) {
    const int n = arm->n;
    double rows[MOST * (KR_MAX_JOINTS + 2)];
    for (int i = 0; i < count; i++, T += 16, seeds += n, q += n) {
        const int kept = kr_solutions(way, prepared, arm, T, seeds, 1, tol, rows);
        if (kept < 0) return i;
        branch[i] = kept ? (long long)rows[0] : -1;
        for (int j = 0; j < n; j++) q[j] = kept ? rows[2 + j] : NAN;
    }
    return -1;
}
