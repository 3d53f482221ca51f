/* Windings and joint limits, of any arm. */
#include "core.h"

#include "chain.h"

#include <math.h>
#include <string.h>

/* How far a joint may be past its limit by rounding; up to how far a posture is moved into the limits [rad]. */
static const double SLACK = 1e-9, NEAR_LIMIT = 1e-3;
/* Steps with which it is moved, and the error at which it has arrived [m, rad]. */
static const int STEPS = 10;
static const double ARRIVED = 1e-12;
/* Joints that a full pose needs; an arm with fewer keeps its position alone. */
static const int POSE_JOINTS = 6;

static double angle_between(const double *a, const double *b, int step) {
    const double x = a[step] * b[2 * step] - a[2 * step] * b[step], y = a[2 * step] * b[0] - a[0] * b[2 * step];
    const double z = a[0] * b[step] - a[step] * b[0];
    return atan2(sqrt(x * x + y * y + z * z), a[0] * b[0] + a[step] * b[step] + a[2 * step] * b[2 * step]);
}

static void goal_error(const kr_arm *arm, int kind, const double *T, const double *q, double error[2]) {
    double F[12 * (KR_MAX_JOINTS + 1)];
    kr_frames(arm->n, arm->placements, q, F);
    const double *tip = F + 12 * arm->n;
    kr_pose_error(tip, T, error);
    if (kind == 1) error[1] = angle_between(tip + 2, T + 2, 4);
    if (kind == 2) error[1] = 0.0;
}

void kr_errors(const kr_arm *arm, int kind, const double *T, const double *rows, int count, double *errors) {
    for (int i = 0; i < count; i++) goal_error(arm, kind, T, rows + (arm->n + 2) * i + 2, errors + 2 * i);
}

/* The posture within the limits whose pose of the tip is nearest to that of another, by damped Newton. */
static void moved_into_limits(const kr_arm *arm, const double *q, double *best) {
    const int n = arm->n, task = n >= POSE_JOINTS ? 6 : 3;
    double F[12 * (KR_MAX_JOINTS + 1)], J[6 * KR_MAX_JOINTS], M[36], error[6], T[12], x[KR_MAX_JOINTS];
    kr_frames(n, arm->placements, q, F);
    memcpy(T, F + 12 * n, sizeof T);
    for (int j = 0; j < n; j++) best[j] = x[j] = fmin(fmax(q[j], arm->lower[j]), arm->upper[j]);
    double least = INFINITY;
    for (int step = 0; step < STEPS; step++) {
        kr_frames(n, arm->placements, x, F);
        kr_twist_to(F + 12 * n, T, error);
        double size = 0.0;
        for (int i = 0; i < task; i++) size = fmax(size, fabs(error[i]));
        if (size < least) memcpy(best, x, n * sizeof *x), least = size;
        if (size < ARRIVED) break;
        kr_jacobian_of(n, F, J);
        for (int j = 0; j < n; j++) {
            double down = 0.0;
            for (int i = 0; i < task; i++) down += J[n * i + j] * error[i];
            if ((x[j] <= arm->lower[j] && down < 0.0) || (x[j] >= arm->upper[j] && down > 0.0))
                for (int i = 0; i < task; i++) J[n * i + j] = 0.0;
        }
        for (int a = 0; a < task; a++)
            for (int b = 0; b < task; b++) {
                double s = a == b ? size + ARRIVED : 0.0;
                for (int j = 0; j < n; j++) s += J[n * a + j] * J[n * b + j];
                M[task * a + b] = s;
            }
        kr_solve(task, 1, M, error);
        for (int j = 0; j < n; j++) {
            double s = 0.0;
            for (int a = 0; a < task; a++) s += J[n * a + j] * error[a];
            x[j] = fmin(fmax(x[j] + s, arm->lower[j]), arm->upper[j]);
        }
    }
}

int kr_allowed(const kr_arm *arm, int kind, const double *T, const double *q, const double *seed, int limits, double tol,
               double *found) {
    double moved[KR_MAX_JOINTS], error[2];
    if (!limits) {
        for (int j = 0; j < arm->n; j++) {
            const double turns = (seed[j] - q[j]) / KR_TURN;
            found[j] = -0.5 <= turns && turns <= 0.5 ? q[j] : q[j] + KR_TURN * rint(turns);
        }
        return 1;
    }
    if (!kr_wound(arm->n, q, seed, arm->lower, arm->upper, NEAR_LIMIT, found)) return 0;
    for (int j = 0; j < arm->n; j++)
        if (!(arm->lower[j] - SLACK <= found[j] && found[j] <= arm->upper[j] + SLACK)) {
            moved_into_limits(arm, found, moved);
            goal_error(arm, kind, T, moved, error);
            if (error[0] <= tol && error[1] <= tol) {
                memcpy(found, moved, arm->n * sizeof *found);
                return 1;
            }
            return kr_wound(arm->n, q, seed, arm->lower, arm->upper, SLACK, found);
        }
    return 1;
}

static int inside_one_turn(int n, const double *q) {
    for (int j = 0; j < n; j++)
        if (!(NEAR_LIMIT - KR_PI < q[j] && q[j] < KR_PI - NEAR_LIMIT)) return 0;
    return 1;
}

/* Insertion sort by the distance from a seed; rows that are equally far keep their order. */
static void sort_by_distance(int n, const double *seed, double *rows, int count) {
    const size_t width = (size_t)n + 2;
    double row[KR_MAX_JOINTS + 2];
    for (int i = 1; i < count; i++) {
        double here = 0.0;
        memcpy(row, rows + width * i, width * sizeof *row);
        for (int j = 0; j < n; j++) here += (row[2 + j] - seed[j]) * (row[2 + j] - seed[j]);
        int k = i;
        for (; k > 0; k--) {
            double before = 0.0;
            const double *q = rows + width * (k - 1) + 2;
            for (int j = 0; j < n; j++) before += (q[j] - seed[j]) * (q[j] - seed[j]);
            if (!(before > here)) break;
            memcpy(rows + width * k, rows + width * (k - 1), width * sizeof *row);
        }
        if (k < i) memcpy(rows + width * k, row, width * sizeof *row);
    }
}

int kr_within(const kr_arm *arm, int kind, const double *T, const double *seed, int limits, double tol, double *rows,
              int count) {
    static const double zero[KR_MAX_JOINTS] = {0.0};
    const double *wanted = seed ? seed : zero;
    const int n = arm->n, single = limits && arm->one_turn;
    const size_t width = (size_t)n + 2;
    int kept = 0;
    if (!seed && (arm->full_turn || !limits)) return count;
    for (int i = 0; i < count; i++) {
        double *row = rows + width * i, *to = rows + width * kept, q[KR_MAX_JOINTS];
        if (single && inside_one_turn(n, row + 2))
            memcpy(q, row + 2, n * sizeof *q);
        else if (!kr_allowed(arm, kind, T, row + 2, wanted, limits, tol, q))
            continue;
        to[0] = row[0], to[1] = row[1];
        memcpy(to + 2, q, n * sizeof *q);
        kept++;
    }
    if (seed) sort_by_distance(n, seed, rows, kept);
    return kept;
}

void kr_turns_along(int count, int stride, const double *q, double lower, double upper, double slack, double *turns) {
    double turn = count > 0 ? -KR_TURN * rint((q[0] - 0.5 * (lower + upper)) / KR_TURN) : 0.0;
    for (int i = 0; i < count; i++) {
        const double angle = q[(long long)stride * i];
        turn -= KR_TURN * fmax(ceil((angle + turn - upper - slack) / KR_TURN), 0.0);
        turn += KR_TURN * fmax(ceil((lower - slack - angle - turn) / KR_TURN), 0.0);
        turns[i] = turn;
    }
}

/* The way on a cubic to a parameter u in [0, 1], from the whole way and the derivatives at both ends. */
static double cubic(double away, double out, double into, double u) {
    return u * u * (3.0 - 2.0 * u) * away + u * (1.0 - u) * ((1.0 - u) * out - u * into);
}

static double within_one(double u) { return u > 0.0 ? fmin(u, 1.0) : 0.0; }

int kr_crossings(int count, int n, const double *begin, const double *away, const double *out, const double *into,
                 const double *lower, const double *upper, const unsigned char *limited, int *which, double *limits,
                 double *shares) {
    enum { BISECTIONS = 16 };
    int found = 0;
    for (int i = 0; i < n * count; i++) {
        const int joint = i % n;
        const double a = away[i], b = out[i], c = into[i];
        for (int k = 0; k < 2 && limited[joint]; k++) {
            const double bound = k ? upper[joint] : lower[joint], y = kr_wrapped(begin[i] - bound);
            const double first = y + b / 3.0, second = y + a - c / 3.0, last = y + a;
            const int below = y <= 0.0 || first <= 0.0 || second <= 0.0 || last <= 0.0;
            if (!below || !(y >= 0.0 || first >= 0.0 || second >= 0.0 || last >= 0.0)) continue;
            /* derivative: b + 2 (3 a - 2 b - c) u + 3 (b + c - 2 a) u^2; monotone between its zeros */
            const double k2 = 3.0 * (b + c - 2.0 * a), k1 = 2.0 * (3.0 * a - 2.0 * b - c);
            const double large = -0.5 * (k1 + copysign(sqrt(fmax(k1 * k1 - 4.0 * k2 * b, 0.0)), k1));
            double ends[4] = {0.0, within_one(k2 != 0.0 ? large / k2 : 0.0), within_one(large != 0.0 ? b / large : 0.0), 1.0};
            if (ends[1] > ends[2]) {
                const double t = ends[1];
                ends[1] = ends[2];
                ends[2] = t;
            }
            for (int part = 0; part < 3; part++) {
                double low = ends[part], high = ends[part + 1];
                const double value = y + cubic(a, b, c, low);
                if (!(high > low && value * (y + cubic(a, b, c, high)) <= 0.0)) continue;
                for (int step = 0; step < BISECTIONS; step++) {
                    const double middle = 0.5 * (low + high);
                    if (value * (y + cubic(a, b, c, middle)) > 0.0) low = middle;
                    else high = middle;
                }
                which[found] = i;
                limits[found] = bound;
                shares[found++] = high;
            }
        }
    }
    return found;
}
