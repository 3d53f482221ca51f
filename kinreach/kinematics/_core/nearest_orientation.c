/* Postures with the tip at a point are a surface for five joints and a curve for four. Where the orientation error is
 * stationary on it, or least on the part that limits leave, Newton's method (`stationary.c`) goes to from starting points.
 * These are found by holding joints: with all but three held, the others follow from the point (`three_joints.c`). Values of
 * the held ones are taken on a grid, and each posture from which one step of Newton's method is short is a start. Joints at
 * a limit are held there. Arms with three parallel axes have starts of their own (`pitched.c`). */
#include "core.h"

#include "chain.h"
#include "pitched.h"
#include "stationary.h"
#include "three_joints.h"

#include <math.h>
#include <string.h>

enum { N = KR_FIVE_JOINTS, CURVE = 72, SURFACE = 24, STARTS = 1024 };
/* A step of Newton's method is short [rad]. Starts closer than this, as a share of the step that leads to them, are one; so
 * are postures [rad]. */
static const double SHORT = 3.0, SAME_START = 0.15, SAME = 1e-5;
/* How far a joint may be past its limit by rounding, and its range less than a full turn [rad]. */
static const double SLACK = 1e-9;
/* By how much the tip may miss its point [m]; of a trace, from that of half a turn. */
static const double MISSED = 1e-9, OPPOSITE = 1e-7;
/* Errors that are equal [rad]; a slope that is none. */
static const double EQUAL = 1e-7, LEVEL = 1e-9;

typedef struct {
    const kr_five_axis *five;
    kr_stationary_goal goal;
    int fixed;                                  /* a joint that does not matter, as a bit */
    int started;
    double starts[STARTS][N];
    int count;
    kr_stationary_posture found[KR_MAX_STATIONARY];
} search;

static double apart(int n, const double *a, const double *b) {
    double most = 0.0;
    for (int i = 0; i < n; i++) most = fmax(most, fabs(kr_wrapped(a[i] - b[i])));
    return most;
}

static int limited(const kr_arm *arm, int joint) {
    return arm->upper[joint] - arm->lower[joint] < KR_TURN - SLACK;
}

static int within_limits(const kr_arm *arm, const double *q) {
    static const double zero[KR_MAX_JOINTS] = {0.0};
    double wound[KR_MAX_JOINTS];
    return kr_wound(arm->n, q, zero, arm->lower, arm->upper, SLACK, wound);
}

/* Keep what Newton's method arrives at. */
static void start_from(void *context, int held, const double *q) {
    search *s = context;
    const kr_arm *arm = s->goal.arm;
    kr_stationary_posture posture;
    if (s->count == KR_MAX_STATIONARY) return;
    memcpy(posture.q, q, arm->n * sizeof *q);
    posture.held = held;
    if (!kr_make_stationary(&s->goal, &posture)) return;
    if (posture.trace < OPPOSITE - 1.0) return;
    const int face = held & ~s->fixed;
    if (face && posture.kind != KR_MINIMUM) return;
    for (int i = 0; i < arm->n; i++) {
        if (!(face >> i & 1)) continue;
        const int at_upper = fabs(posture.q[i] - arm->upper[i]) <= fabs(posture.q[i] - arm->lower[i]);
        if (at_upper ? posture.slope[i] < -LEVEL : posture.slope[i] > LEVEL) return;
    }
    if (face && !within_limits(arm, posture.q)) return;
    for (int k = 0; k < s->count; k++) {
        if (!(apart(arm->n, s->found[k].q, posture.q) < SAME)) continue;
        if (face && !within_limits(arm, s->found[k].q)) s->found[k] = posture;  /* stationary a rounding past a limit, too */
        return;
    }
    s->found[s->count++] = posture;
}

/* The chain of three free joints, with the others at their angles. */
static void chain_of(const kr_arm *arm, int free, const double *q, double B[48]) {
    double here[12], turned[12];
    int part = 0;
    memcpy(here, arm->placements, sizeof here);
    for (int i = 0; i < arm->n; i++) {
        const double *A = arm->placements + 12 * (i + 1);
        if (free >> i & 1) {
            memcpy(B + 12 * part++, here, sizeof here);
            memcpy(here, A, sizeof here);
            continue;
        }
        const double c = cos(q[i]), s = sin(q[i]);
        for (int r = 0; r < 12; r += 4) {
            turned[r] = c * here[r] + s * here[r + 1], turned[r + 1] = c * here[r + 1] - s * here[r];
            turned[r + 2] = here[r + 2], turned[r + 3] = here[r + 3];
        }
        kr_times(turned, A, here);
    }
    memcpy(B + 36, here, sizeof here);
}

/* Try the postures that reach the point with all joints but three at their angles. */
static void reach(search *s, int held, int triple, double q[N]) {
    double B[48], angles[3 * KR_MAX_TRIPLES], step[N];
    const int n = s->goal.arm->n;
    chain_of(s->goal.arm, triple, q, B);
    const int count = kr_three_joints(B, s->goal.p, angles);
    for (int k = 0; k < count; k++) {
        for (int i = 0, part = 0; i < n; i++)
            if (triple >> i & 1) q[i] = angles[3 * k + part++];
        if ((held | triple) != (1 << n) - 1) {
            double there[N], longest = 0.0;
            if (!kr_stationary_step(&s->goal, held, q, step)) continue;
            for (int i = 0; i < n; i++) longest = fmax(longest, fabs(step[i])), there[i] = q[i] + step[i];
            if (!(longest < SHORT)) continue;
            int known = 0;
            for (int j = 0; j < s->started && !known; j++) known = apart(n, s->starts[j], there) < SAME_START * longest;
            if (known) continue;
            if (s->started < STARTS) memcpy(s->starts[s->started++], there, sizeof there);
        }
        start_from(s, held, q);
    }
}

/* Hold some joints, take values of all others but three on a grid. */
static void scan_by(search *s, int held, int triple, int finer, double q[N]) {
    const int n = s->goal.arm->n;
    int others[2] = {0, 0}, count = 0;
    for (int i = 0; i < n; i++)
        if (!((held | triple) >> i & 1)) others[count++] = i;
    if (count == 0) reach(s, held, triple, q);
    const int curve = finer * CURVE, surface = finer * SURFACE;
    for (int i = 0; count == 1 && i < curve; i++) {
        q[others[0]] = KR_TURN * (i + 0.5) / curve - KR_PI;
        reach(s, held, triple, q);
    }
    for (int i = 0; count == 2 && i < surface * surface; i++) {
        q[others[0]] = KR_TURN * (i / surface + 0.5) / surface - KR_PI;
        q[others[1]] = KR_TURN * (i % surface + 0.5) / surface - KR_PI;
        reach(s, held, triple, q);
    }
}

/* By the two best ways. Without limits the stationary postures on a closed curve or surface are even in number, because
 * minima and maxima less saddles are its Euler characteristic (M. Morse): where they are odd, the grid becomes finer. */
static void scan(search *s, int held, double q[N]) {
    if (!s->five->triple[held][0]) return;
    for (int finer = 1; finer <= 2; finer++) {
        s->started = 0;
        for (int way = 0; way < 2 && s->five->triple[held][way]; way++)
            scan_by(s, held, s->five->triple[held][way], finer, q);
        if (held & ~s->fixed || s->count % 2 == 0) break;
    }
}

/* The same with one joint or two of those that matter at a limit. */
static void scan_limits(search *s, double q[N]) {
    const kr_arm *arm = s->goal.arm;
    const int n = arm->n;
    int free = n;
    for (int i = 0; i < n; i++) free -= s->fixed >> i & 1;
    for (int i = 0; i < n; i++) {
        if (s->fixed >> i & 1 || !limited(arm, i) || free < 4) continue;
        for (int end = 0; end < 2; end++) {
            q[i] = end ? arm->upper[i] : arm->lower[i];
            scan(s, s->fixed | 1 << i, q);
            for (int j = 0; j < i; j++) {
                if (s->fixed >> j & 1 || !limited(arm, j) || free < 5) continue;
                for (int other = 0; other < 2; other++) {
                    q[i] = end ? arm->upper[i] : arm->lower[i];
                    q[j] = other ? arm->upper[j] : arm->lower[j];
                    scan(s, s->fixed | 1 << i | 1 << j, q);
                }
            }
        }
    }
}

/* Whether a row comes before another: less is left of the orientation, or it is nearer to the seed. */
static int before(int n, const double *seed, const double *a, double left_a, const double *b, double left_b) {
    double near_a = 0.0, near_b = 0.0;
    if (fabs(left_a - left_b) > EQUAL) return left_a < left_b;
    for (int i = 0; i < n; i++) {
        near_a += (a[2 + i] - seed[i]) * (a[2 + i] - seed[i]);
        near_b += (b[2 + i] - seed[i]) * (b[2 + i] - seed[i]);
    }
    return near_a < near_b;
}

int kr_nearest_orientations(const kr_five_axis *five, const kr_arm *arm, int kind, const double T[16],
                            const double *seed, int limits, double *rows, double *errors) {
    static const double zero[KR_MAX_JOINTS] = {0.0};
    const double *wanted = seed ? seed : zero;
    const int n = arm->n, width = n + 2;
    double q[N], row[N + 2], error[2];
    search s;
    if (kind == 0 && !kr_is_rigid(T)) return -1;
    memset(s.goal.W, 0, sizeof s.goal.W);
    s.five = five, s.count = s.started = 0;
    s.goal.arm = arm, s.goal.most = kind ? 1.0 : 3.0;
    for (int r = 0; r < 3; r++) {
        s.goal.p[r] = T[4 * r + 3];
        for (int c = kind ? 2 : 0; c < 3; c++) s.goal.W[3 * r + c] = T[4 * r + c];
    }
    memcpy(q, wanted, n * sizeof *q);
    s.fixed = kind && five->last_turns_tip ? 1 << (n - 1) : 0;
    if (limits) q[n - 1] = fmin(fmax(q[n - 1], arm->lower[n - 1]), arm->upper[n - 1]);
    const int pitched = five->pitched && !(s.fixed && n == 4);
    if (pitched) kr_pitched_starts(five, &s.goal, s.fixed, limits, q, start_from, &s);
    else scan(&s, s.fixed, q);
    if (limits && !pitched) scan_limits(&s, q);
    int kept = 0;
    for (int k = 0; k < s.count; k++) {
        const kr_stationary_posture *posture = s.found + k;
        row[1] = posture->kind;
        for (int i = 0; i < n; i++)
            if ((posture->held & ~s.fixed) >> i & 1 && fabs(posture->slope[i]) > LEVEL) row[1] = 3.0;
        if (limits ? !kr_wound(n, posture->q, wanted, arm->lower, arm->upper, SLACK, row + 2)
                   : !kr_allowed(arm, 2, T, posture->q, wanted, 0, MISSED, row + 2))
            continue;
        kr_errors(arm, kind, T, row, 1, error);
        if (!(error[0] < MISSED)) continue;
        int at = kept++;
        for (; at > 0 && before(n, wanted, row, error[1], rows + width * (at - 1), errors[2 * at - 1]); at--) {
            memcpy(rows + width * at, rows + width * (at - 1), width * sizeof *row);
            memcpy(errors + 2 * at, errors + 2 * at - 2, sizeof error);
        }
        memcpy(rows + width * at, row, width * sizeof *row);
        memcpy(errors + 2 * at, error, sizeof error);
    }
    for (int k = 0; k < kept; k++) rows[width * k] = k;
    return kept;
}

/* How well three joints move the tip, over random postures: 0 if never in all directions. */
static double mobility(const kr_arm *arm, int triple) {
    enum { TRIALS = 32 };
    double sum = 0.0, F[12 * (N + 1)], J[6 * N], q[N];
    unsigned long long state = 88172645463325252ULL;
    for (int trial = 0; trial < TRIALS; trial++) {
        double M[9] = {0.0}, norm = 1.0;
        for (int i = 0; i < arm->n; i++) {
            state ^= state << 13, state ^= state >> 7, state ^= state << 17;
            q[i] = KR_TURN * ((double)(state >> 11) / 9007199254740992.0 - 0.5);
        }
        kr_frames(arm->n, arm->placements, q, F);
        kr_jacobian_of(arm->n, F, J);
        for (int i = 0, c = 0; i < arm->n; i++) {
            if (!(triple >> i & 1)) continue;
            for (int r = 0; r < 3; r++) M[3 * r + c] = J[arm->n * r + i];
            norm *= M[c] * M[c] + M[3 + c] * M[3 + c] + M[6 + c] * M[6 + c];
            c++;
        }
        const double det = M[0] * (M[4] * M[8] - M[5] * M[7]) - M[1] * (M[3] * M[8] - M[5] * M[6]) +
                           M[2] * (M[3] * M[7] - M[4] * M[6]);
        if (norm > 0.0) sum += fabs(det) / sqrt(norm);
    }
    return sum / TRIALS;
}

int kr_five_axis_prepare(const kr_arm *arm, kr_five_axis *five) {
    /* How far the tip may be from the last joint's axis for that joint to turn about it [m, and sine of an angle]: a right
     * angle in a URDF is often written as 1.5708. The other joints make up for it. */
    static const double IMMOBILE = 1e-7, ON_AXIS = 1e-5;
    const int n = arm->n, all = (1 << n) - 1;
    const double *tip = arm->placements + 12 * n;
    double score[32] = {0.0};
    memset(five, 0, sizeof *five);
    five->last_turns_tip = hypot(tip[2], tip[6]) < ON_AXIS && hypot(tip[3], tip[7]) < ON_AXIS;
    for (int set = 0; set <= all; set++) {
        int joints = 0;
        for (int i = 0; i < n; i++) joints += set >> i & 1;
        if (joints == 3) score[set] = mobility(arm, set);
    }
    for (int held = 0; held <= all; held++)
        for (int set = 0; set <= all; set++)
            if (!(set & held) && score[set] > IMMOBILE) {
                int *best = five->triple[held];
                if (!best[0] || score[set] > score[best[0]])
                    best[1] = best[0], best[0] = set;
                else if (!best[1] || score[set] > score[best[1]])
                    best[1] = set;
            }
    kr_pitched_prepare(arm, five);
    return five->triple[0][0] != 0;
}
