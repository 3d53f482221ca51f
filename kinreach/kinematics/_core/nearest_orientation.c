/* Postures with the tip at a point are a surface for five joints and a curve for four. Where the orientation error is
 * stationary on it, or least on the part that limits leave, Newton's method (`stationary.c`) goes to from starting points.
 * These are found by holding joints: with all but three held, the others follow from the point (`three_joints.c`). Values of
 * the held ones are taken on a grid, and each posture from which one step of Newton's method is short is a start, as are some
 * of each surface between points of the grid. Joints at a limit are held there. Arms with three parallel axes have starts of
 * their own (`pitched.c`). */
#include "core.h"

#include "chain.h"
#include "circle.h"
#include "pitched.h"
#include "stationary.h"
#include "three_joints.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { N = KR_FIVE_JOINTS, CURVE = 108, SURFACE = 24, AROUND = 24, STARTS = 1024, CENTRES = 64 };
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
    double function[6];                         /* of the last of three joints, 0 where they reach the point */
    float grid[SURFACE * SURFACE][AROUND];      /* its values */
    int centres;
    double centre[CENTRES][N];                  /* of surfaces between points of the grid */
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
    posture.held = held, posture.face = held & ~s->fixed;
    if (!kr_make_stationary(&s->goal, &posture)) return;
    if (posture.trace < OPPOSITE - 1.0) return;
    if (posture.face && !within_limits(arm, posture.q)) return;
    for (int k = 0; k < s->count; k++) {
        if (!(apart(arm->n, s->found[k].q, posture.q) < SAME)) continue;
        if (posture.face && !within_limits(arm, s->found[k].q)) s->found[k] = posture;  /* stationary a rounding past a limit, too */
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
    const int count = kr_three_joints(B, s->goal.p, s->function, angles);
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

/* The joints but three and those held, then the last of the three. Returns how many. */
static int variables(int n, int held, int triple, int joints[3]) {
    int count = 0, last = 0;
    for (int i = 0; i < n; i++) {
        if (triple >> i & 1) last = i;
        else if (!(held >> i & 1)) joints[count++] = i;
    }
    joints[count++] = last;
    return count;
}

/* The function of the last of three joints that is 0 where they reach the point. */
static double function_at(const search *s, int triple, int last, const double *q) {
    double B[48], k[6];
    chain_of(s->goal.arm, triple, q, B);
    kr_three_joints(B, s->goal.p, k, NULL);
    return kr_circle_value(k, cos(q[last]), sin(q[last]));
}

/* Go by Newton's method from a point of the grid to an extremum next to it. If the function has the other sign there, start
 * from postures on all sides of it, unless that was done from another point. */
static void enclosed(search *s, int held, int triple, const int *joints, int count, double q[N]) {
    enum { STEPS = 5 };
    static const double H = 1e-3, LONGEST = 0.3, MARGIN = 3.0, INSIDE = 0.7, SAME_CENTRE = 0.05;
    const int last = joints[count - 1];
    double bend[3], middle = function_at(s, triple, last, q), centre[N];
    const double sign = middle < 0.0 ? 1.0 : -1.0;
    for (int step = 0; step < STEPS; step++) {
        double high[3], slope[3], x[3], M[9], at[N], longest = 0.0, gain = 0.0;
        memcpy(at, q, sizeof at);
        for (int i = 0; i < count; i++) {
            at[joints[i]] = q[joints[i]] + H, high[i] = function_at(s, triple, last, at);
            at[joints[i]] = q[joints[i]] - H;
            const double low = function_at(s, triple, last, at);
            at[joints[i]] = q[joints[i]];
            slope[i] = x[i] = (low - high[i]) / (2.0 * H);
            M[count * i + i] = bend[i] = (high[i] - 2.0 * middle + low) / (H * H);
        }
        for (int i = 0; i < count; i++)
            for (int j = 0; j < i; j++) {
                at[joints[i]] = q[joints[i]] + H, at[joints[j]] = q[joints[j]] + H;
                const double both = function_at(s, triple, last, at);
                M[count * i + j] = M[count * j + i] = (both - high[i] - high[j] + middle) / (H * H);
                at[joints[i]] = q[joints[i]], at[joints[j]] = q[joints[j]];
            }
        if (!(kr_solve(count, 1, M, x) > 0.0)) return;
        for (int i = 0; i < count; i++) longest = fmax(longest, fabs(x[i])), gain -= 0.5 * sign * slope[i] * x[i];
        if (!(longest < INFINITY) || (step == 0 && sign * middle + MARGIN * gain <= 0.0)) return;
        for (int i = 0; i < count; i++) q[joints[i]] += x[i] * fmin(1.0, LONGEST / longest);
        middle = function_at(s, triple, last, q);
        if (longest < H) break;
    }
    if (!(sign * middle > 0.0)) return;
    memcpy(centre, q, sizeof centre);
    for (int i = 0; i < s->goal.arm->n; i++)
        if ((triple & ~(1 << last)) >> i & 1) centre[i] = 0.0;
    for (int k = 0; k < s->centres; k++)
        if (apart(s->goal.arm->n, s->centre[k], centre) < SAME_CENTRE) return;
    if (s->centres < CENTRES) memcpy(s->centre[s->centres++], centre, sizeof centre);
    reach(s, held, triple, q);
    for (int i = 0; i + 1 < count; i++) {
        const double radius = sqrt(fabs(2.0 * middle / bend[i]));
        for (int side = -1; side <= 1 && radius < INFINITY; side += 2) {
            memcpy(q, centre, sizeof centre);
            q[joints[i]] += side * INSIDE * radius;
            reach(s, held, triple, q);
        }
    }
}

/* The postures at the point are the zeros of one function of the joints. A surface, or a curve, so small that no point of the
 * grid is inside encloses an extremum whose sign is not that of the points around: there a paraboloid through them comes
 * to 0, or almost. */
static void scan_between(search *s, int held, int triple, double q[N]) {
    /* by how much the paraboloid may be too low; how far away it holds, in steps of the grid */
    static const double MARGIN = 3.0, NEXT = 1.2;
    int joints[3];
    const int count = variables(s->goal.arm->n, held, triple, joints);
    const int rows = count == 3 ? SURFACE : 1, columns = count == 3 ? SURFACE : CURVE;
    s->centres = 0;
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) {
            const float *at[3][3];
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 3; b++)
                    at[a][b] = s->grid[columns * ((i + a + rows - 1) % rows) + (j + b + columns - 1) % columns];
            for (int k = 0; k < AROUND; k++) {
                const int less = k ? k - 1 : AROUND - 1, more = k + 1 < AROUND ? k + 1 : 0;
                const float value = at[1][1][k], sign = value < 0.0f ? 1.0f : -1.0f;
                const float near[3][2] = {
                    {at[1][1][less], at[1][1][more]}, {at[1][0][k], at[1][2][k]}, {at[0][1][k], at[2][1][k]}};
                double M[9], slope[3], x[3], gain = 0.0, longest = 0.0, bends = 0.0;
                int d = 0;
                for (; d < count && sign * near[d][0] < 0.0f && sign * near[d][1] < 0.0f; d++) {
                    slope[d] = x[d] = 0.5 * (near[d][0] - near[d][1]);
                    M[count * d + d] = near[d][0] + near[d][1] - 2.0 * value;
                    bends -= sign * M[count * d + d];
                }
                if (d < count || -sign * value > 0.5 * MARGIN * bends) continue;
                M[1] = M[count] = 0.25 * (at[1][2][more] - at[1][2][less] - at[1][0][more] + at[1][0][less]);
                if (count == 3) {
                    M[2] = M[6] = 0.25 * (at[2][1][more] - at[2][1][less] - at[0][1][more] + at[0][1][less]);
                    M[5] = M[7] = 0.25 * (at[2][2][k] - at[2][0][k] - at[0][2][k] + at[0][0][k]);
                }
                if (!(kr_solve(count, 1, M, x) > 0.0)) continue;
                for (d = 0; d < count; d++) longest = fmax(longest, fabs(x[d])), gain -= 0.5 * sign * slope[d] * x[d];
                if (!(longest < NEXT) || !(MARGIN * gain > -sign * value)) continue;
                q[joints[count - 1]] = KR_TURN * (k + 0.5) / AROUND - KR_PI;
                q[joints[count - 2]] = KR_TURN * (j + 0.5) / columns - KR_PI;
                if (count == 3) q[joints[0]] = KR_TURN * (i + 0.5) / rows - KR_PI;
                enclosed(s, held, triple, joints, count, q);
            }
        }
}

/* Hold some joints, take values of all others but three on a grid. */
static void scan_by(search *s, int held, int triple, int finer, double q[N]) {
    int joints[3];
    const int count = variables(s->goal.arm->n, held, triple, joints);
    const int columns = count == 3 ? finer * SURFACE : count == 2 ? finer * CURVE : 1, rows = count == 3 ? columns : 1;
    double c[AROUND], sine[AROUND];
    for (int k = 0; k < AROUND; k++)
        c[k] = cos(KR_TURN * (k + 0.5) / AROUND - KR_PI), sine[k] = sin(KR_TURN * (k + 0.5) / AROUND - KR_PI);
    for (int i = 0; i < rows; i++)
        for (int j = 0; j < columns; j++) {
            if (count == 3) q[joints[0]] = KR_TURN * (i + 0.5) / rows - KR_PI;
            if (count > 1) q[joints[count - 2]] = KR_TURN * (j + 0.5) / columns - KR_PI;
            reach(s, held, triple, q);
            for (int k = 0; finer == 1 && count > 1 && k < AROUND; k++)
                s->grid[columns * i + j][k] = (float)kr_circle_value(s->function, c[k], sine[k]);
        }
    if (finer == 1 && count > 1) scan_between(s, held, triple, q);
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
    s.goal.arm = arm;
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
            if (posture->face >> i & 1 && fabs(posture->slope[i]) > LEVEL) row[1] = 3.0;
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
