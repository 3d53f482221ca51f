/* Every posture of a six-axis arm that decouples, or almost: from its closed forms, tried on the arm as it is given.
 *
 * A regular pose has the postures of the closed form. Where a pose is singular, what is singular by less than the
 * tolerance of the closed form is free, and otherwise it is not: several tolerances find the postures of both. Those that
 * miss the pose go there by Newton's method. If the widest tolerance has one from which that fails, two singularities are
 * close to each other, and all joints that are free take many values. */
#include "six_axis.h"

#include "chain.h"
#include "decoupled.h"
#include "newton.h"
#include "rows.h"
#include "sincos.h"

#include <math.h>
#include <string.h>

enum { JOINTS = 6, WIDTH = 8, BRANCHES = 8, SLOTS = 16, MOST_FOUND = 1024 };
/* By how much a posture may miss its pose and be counted as exact; by how much parts of the geometry may be missed where
 * the pose is singular: where two are singular at once, rounding grows to this [m, rad]. */
static const double MISSED = 1e-9, AMISS = 1e-4;
/* Newton's method moves a joint less than this on the way to the posture of the same branch [rad]. */
static const double FAR = 0.1;
/* Postures closer than this in every joint are the same [rad]. */
static const double SAME = 1e-6;
/* Steps of Newton's method to a posture of the same branch, and near a singularity. */
enum { STEPS = 6, MOST_STEPS = 40 };
/* How many angles of a free joint are tried; of several, so many times as many. */
enum { TURNS = 36, SEVERAL = 3, MOST_HANDS = 20 };
/* By how much an elbow may be missed at such an angle, to be reached at one near it [m, rad]; by how much a start of
 * Newton's method may miss its pose. */
static const double FAR_MISS = 0.03;
/* Joints that move the wrist, and the last one, as bits. */
enum { POSITIONING = 1 | 2 | 4, LAST = 32 };
/* Samples of a family of postures are tried with so many others, are apart by less than this [rad], and the posture
 * between them is near their middle, in shares of their distance. */
enum { NEIGHBOURS = 4 };
static const double NEIGHBOURING = 0.6, BETWEEN = 0.2;

/* Whether postures are nearer than a distance in every joint [rad]. */
static int nearer(const double *a, const double *b, double distance) {
    for (int j = 0; j < JOINTS; j++)
        if (!(fabs(kr_wrapped(a[j] - b[j])) < distance)) return 0;
    return 1;
}

static double apart(const double *a, const double *b) {
    double most = 0.0;
    for (int j = 0; j < JOINTS; j++) most = fmax(most, fabs(kr_wrapped(a[j] - b[j])));
    return most;
}

/* Go on by Newton's method from a posture q that misses a pose; a joint that would move by `far` stays where it is [rad].
 * Returns by how much q then misses it. */
static double refined(const kr_decoupled *arm, const double T[12], double q[JOINTS], double far) {
    double x[JOINTS], most = 0.0;
    const double missed = kr_missed(arm->placements, T, q);
    if (missed <= MISSED) return missed;
    memcpy(x, q, sizeof x);
    const double left = kr_damped_newton(arm->placements, T, MOST_STEPS, x);
    for (int j = 0; j < JOINTS; j++) most = fmax(most, fabs(x[j] - q[j]));
    if (!(left < missed && most < far)) return missed;
    for (int j = 0; j < JOINTS; j++) q[j] = kr_wrapped(x[j]);
    return left;
}

/* Postures that reach, apart from each other. */
typedef struct {
    int count, branch[MOST_FOUND], flags[MOST_FOUND];
    double q[MOST_FOUND * JOINTS];
} exact_t;

/* The first posture of each branch that misses by up to a tolerance. */
typedef struct {
    double tol, rows[BRANCHES * WIDTH];
    int has;
} inexact_t;

/* Take a posture of a closed form that has been refined. */
static void take(exact_t *exact, inexact_t *inexact, const double *row, double missed) {
    const int branch = (int)row[0];
    if (missed <= MISSED) {
        for (int i = 0; i < exact->count; i++)
            if (nearer(exact->q + JOINTS * i, row + 2, SAME)) return;
        if (exact->count == MOST_FOUND) return;
        exact->branch[exact->count] = branch, exact->flags[exact->count] = (int)row[1];
        memcpy(exact->q + JOINTS * exact->count++, row + 2, JOINTS * sizeof *row);
    } else if (missed <= inexact->tol && branch < BRANCHES && !(inexact->has >> branch & 1)) {
        inexact->has |= 1 << branch;
        memcpy(inexact->rows + WIDTH * branch, row, WIDTH * sizeof *row);
    }
}

/* Starts in which the joints that are free, as bits, take many values. */
typedef struct {
    int free, count, total, hands;
    double seed[JOINTS], q1[MOST_HANDS];
} samples_t;

static void prepare_samples(const kr_decoupled *arm, const double T[12], double tol, const double *seed, int free,
                            samples_t *samples) {
    int joints = 0;
    for (int j = 0; j < JOINTS; j++) joints += free >> j & 1;
    samples->free = free, samples->count = joints > 1 ? SEVERAL * TURNS : joints * TURNS;
    samples->hands = free & 1 ? kr_decoupled_hands(arm, T, tol, samples->q1) : 0;
    samples->total = samples->count + samples->hands * (samples->count / SEVERAL);
    memcpy(samples->seed, seed, sizeof samples->seed);
}

/* One joint after the other takes angles that are shares of a turn apart. */
static void sample(const samples_t *samples, int index, double start[JOINTS]) {
    /* square roots of 5, 2, 3, 7, 11 and 13, without their integers */
    static const double SHARES[JOINTS] = {0.23606797749978969, 0.41421356237309515, 0.73205080756887719,
                                          0.64575131106459072, 0.31662479035539981, 0.60555127546398912};
    const int few = samples->count / SEVERAL, hand = index < samples->count ? -1 : (index - samples->count) / few;
    const int step = hand < 0 ? index : SEVERAL * ((index - samples->count) % few);
    memcpy(start, samples->seed, sizeof samples->seed);
    for (int j = 0, share = 0; j < JOINTS; j++)
        if (samples->free >> j & 1) start[j] += KR_TURN * (step + 1) * SHARES[share++];
    if (hand >= 0) start[0] = samples->q1[hand];
}

static int root_of(int *first, int i) {
    while (first[i] != i) i = first[i] = first[first[i]];
    return i;
}

void kr_families(const double placements[84], const double T[12], const double *q, int count, int *first) {
    for (int i = 0; i < count; i++) first[i] = i;
    for (int i = 0; i < count; i++) {
        const double *one = q + JOINTS * i;
        double distance[NEIGHBOURS];
        int near[NEIGHBOURS], near_count = 0;
        for (int k = 0; k < count; k++) {
            if (k == i) continue;
            const double away = apart(one, q + JOINTS * k);
            if (!(away < NEIGHBOURING) || (near_count == NEIGHBOURS && away >= distance[NEIGHBOURS - 1])) continue;
            int at = near_count < NEIGHBOURS ? near_count++ : NEIGHBOURS - 1;
            for (; at > 0 && distance[at - 1] > away; at--) distance[at] = distance[at - 1], near[at] = near[at - 1];
            distance[at] = away, near[at] = k;
        }
        for (int k = 0; k < near_count; k++) {
            const int a = root_of(first, i), b = root_of(first, near[k]);
            double middle[JOINTS], found[JOINTS], moved = 0.0;
            if (a == b) continue;
            for (int j = 0; j < JOINTS; j++)
                found[j] = middle[j] = one[j] + 0.5 * kr_wrapped(q[JOINTS * near[k] + j] - one[j]);
            const double missed = kr_damped_newton(placements, T, MOST_STEPS, found);
            for (int j = 0; j < JOINTS; j++) moved = fmax(moved, fabs(found[j] - middle[j]));
            if (missed < MISSED && moved < BETWEEN * distance[k]) first[a > b ? a : b] = a > b ? b : a;
        }
    }
    for (int i = 0; i < count; i++) first[i] = root_of(first, i);
}

/* Postures of a pose that may be singular. */
static int singular(const kr_decoupled *arm, const double T[12], const double seed[JOINTS], double tol, double *rows) {
    const double tols[4] = {MISSED, KR_EXACT, tol, AMISS}, least = fmin(KR_EXACT, tol);
    double near[KR_MAX_ROWS * WIDTH], known[8 * KR_MAX_ROWS * JOINTS];
    kr_doubt doubt = {0, 0.0, 0};
    exact_t exact;
    inexact_t inexact;
    int first[MOST_FOUND], known_count = 0, missing = 0, taken = 0, slot[BRANCHES];
    exact.count = 0, inexact.tol = tol, inexact.has = 0;
    for (int k = 0; k < 4; k++)
        for (int narrow = 0; narrow < (tols[k] > least ? 2 : 1); narrow++) {
            const int count = kr_decoupled_solved(arm, T, tols[k], narrow ? least : tols[k], seed, &doubt, near);
            for (int i = 0; i < count; i++) {
                double *row = near + WIDTH * i;
                int same = 0;
                for (int other = 0; other < known_count && !same; other++)
                    same = nearer(known + JOINTS * other, row + 2, SAME);
                if (same) continue;
                memcpy(known + JOINTS * known_count++, row + 2, JOINTS * sizeof *row);
                const double missed = refined(arm, T, row + 2, FAR);
                if (!(missed <= MISSED)) missing = 1;
                take(&exact, &inexact, row, missed);
            }
        }
    samples_t samples;
    prepare_samples(arm, T, AMISS, seed, doubt.free & (missing ? POSITIONING | LAST : POSITIONING), &samples);
    for (int k = 0; k < samples.total; k++) {
        double start[JOINTS];
        sample(&samples, k, start);
        for (int far = 0; far < 2; far++) {
            const double wide = far ? FAR_MISS : AMISS;
            const int count = kr_decoupled_solved(arm, T, wide, wide, start, NULL, near);
            for (int i = 0; i < count; i++)
                take(&exact, &inexact, near + WIDTH * i, refined(arm, T, near + WIDTH * i + 2, INFINITY));
        }
    }
    if (!exact.count) {
        int count = 0;
        for (int branch = 0; branch < BRANCHES; branch++)
            if (inexact.has >> branch & 1)
                memcpy(rows + WIDTH * count++, inexact.rows + WIDTH * branch, WIDTH * sizeof *rows);
        return count;
    }
    if (samples.total) {
        kr_families(arm->placements, T, exact.q, exact.count, first);
        int kept = 0;
        for (int i = 0; i < exact.count; i++) {
            if (first[i] != i) continue;
            exact.branch[kept] = exact.branch[i], exact.flags[kept] = exact.flags[i];
            memmove(exact.q + JOINTS * kept++, exact.q + JOINTS * i, JOINTS * sizeof *exact.q);
        }
        exact.count = kept;
    }
    for (int i = 0; i < exact.count; i++) {
        const int branch = exact.branch[i];
        first[i] = branch < BRANCHES && !(taken >> branch & 1);  /* has its own name */
        if (first[i]) taken |= 1 << branch, slot[branch] = i;
    }
    for (int i = 0, branch = 0; i < exact.count; i++) {
        if (first[i]) continue;
        while (branch < BRANCHES && (taken >> branch & 1)) branch++;
        if (branch == BRANCHES) break;
        taken |= 1 << branch, slot[branch] = i;
    }
    int count = 0;
    for (int branch = 0; branch < BRANCHES; branch++) {
        if (!(taken >> branch & 1)) continue;
        double *row = rows + WIDTH * count++;
        row[0] = branch, row[1] = exact.flags[slot[branch]];
        memcpy(row + 2, exact.q + JOINTS * slot[branch], JOINTS * sizeof *row);
    }
    return count;
}

/* The frame of the next joint before its turn, or of the tip: f Rz(angle) A. */
static void next_frame(const double f[12], double c, double s, const double A[12], double next[12]) {
    double turned[12];
    for (int r = 0; r < 12; r += 4) {
        turned[r] = c * f[r] + s * f[r + 1], turned[r + 1] = c * f[r + 1] - s * f[r];
        turned[r + 2] = f[r + 2], turned[r + 3] = f[r + 3];
    }
    kr_times(turned, A, next);
}

/* Whether all rows of up to eight postures reach a pose for certain: entries of transforms are compared, which is faster
 * than how much each of them misses by. Neighbouring rows may have their first three joints in common. */
static int all_reach(const kr_decoupled *arm, const double T[12], const double *rows, int count) {
    const double *A = arm->placements;
    double q[BRANCHES * JOINTS], s[BRANCHES * JOINTS], c[BRANCHES * JOINTS], middle[12], f[12], g[12];
    for (int i = 0; i < count; i++) memcpy(q + JOINTS * i, rows + WIDTH * i + 2, JOINTS * sizeof *q);
    kr_sincos_of_each(count * JOINTS, q, s, c);
    for (int i = 0; i < count; i++) {
        const double *angle = q + JOINTS * i, *sine = s + JOINTS * i, *cosine = c + JOINTS * i;
        const int same = i && angle[0] == angle[-JOINTS] && angle[1] == angle[1 - JOINTS] && angle[2] == angle[2 - JOINTS];
        int near = 1;
        if (!same) {
            next_frame(A, cosine[0], sine[0], A + 12, f);
            next_frame(f, cosine[1], sine[1], A + 24, g);
            next_frame(g, cosine[2], sine[2], A + 36, middle);
        }
        next_frame(middle, cosine[3], sine[3], A + 48, f);
        next_frame(f, cosine[4], sine[4], A + 60, g);
        next_frame(g, cosine[5], sine[5], A + 72, f);
        for (int k = 0; k < 12; k++) near &= fabs(f[k] - T[k]) < 0.25 * MISSED;
        if (!near) return 0;
    }
    return 1;
}

int kr_decoupled_postures(const kr_decoupled *arm, const double T[12], const double seed[JOINTS], double tol,
                          double *rows) {
    double found[KR_MAX_ROWS * WIDTH];
    const int count = kr_decoupled_solved(arm, T, tol, tol, seed, NULL, found);
    int regular = 0 < count && count <= BRANCHES;
    for (int i = 0; i < count && regular; i++) regular = found[WIDTH * i + 1] == 0.0 && found[WIDTH * i] < BRANCHES;
    const int tried = regular && all_reach(arm, T, found, count);
    for (int i = 0; i < count && regular && !(tried && arm->by_shoulder); i++) {
        double *q = found + WIDTH * i + 2;
        regular = tried || refined(arm, T, q, FAR) <= MISSED;  /* roots that almost merge are inexact */
        for (int k = 0; k < i && regular && !arm->by_shoulder; k++) regular = !nearer(found + WIDTH * k + 2, q, SAME);
    }
    if (!regular) return singular(arm, T, seed, tol, rows);
    kr_sort_by_branch(found, count);
    memcpy(rows, found, count * WIDTH * sizeof *rows);
    return count;
}

void kr_decoupled_postures_of_each(const kr_decoupled *arm, const double *T, const double *seeds, int count, double tol,
                                   double *q, unsigned char *valid) {
    double rows[BRANCHES * WIDTH];
    for (int i = 0; i < count; i++) {
        const int found = kr_decoupled_postures(arm, T + 16 * i, seeds + JOINTS * i, tol, rows);
        kr_by_branch(JOINTS, BRANCHES, rows, found, q + BRANCHES * JOINTS * i, valid + BRANCHES * i);
    }
}

int kr_decoupled_rows(const kr_decoupled *arm, const double T[12], double tol, const double seed[JOINTS], int samples_too,
                      int *free, double *rows) {
    kr_doubt doubt = {0, 0.0, 0};
    int count = kr_decoupled_solved(arm, T, tol, tol, seed, &doubt, rows);
    *free = doubt.free;
    if (!samples_too) return count;
    samples_t samples;
    prepare_samples(arm, T, tol, seed, doubt.free, &samples);
    for (int k = 0; k < samples.total; k++) {
        double start[JOINTS];
        sample(&samples, k, start);
        count += kr_decoupled_solved(arm, T, tol, tol, start, NULL, rows + WIDTH * count);
        count += kr_decoupled_solved(arm, T, FAR_MISS, FAR_MISS, start, NULL, rows + WIDTH * count);
    }
    return count;
}

int kr_decoupled_starts(const kr_decoupled *arm, const double *T, int count, double *q, long long *pose) {
    static const double zero[JOINTS] = {0.0};
    double rows[KR_MAX_ROWS * WIDTH];
    int total = 0;
    for (int i = 0; i < count; i++) {
        int regular = 1;
        for (int wide = 0; wide < 2 && regular < 2; wide++) {
            const double tol = wide ? FAR_MISS : KR_EXACT;
            const int found = kr_decoupled_solved(arm, T + 16 * i, tol, tol, zero, NULL, rows);
            for (int k = 0; k < found; k++) {
                if (rows[WIDTH * k + 1] != 0.0) regular = 0;
                memcpy(q + JOINTS * total, rows + WIDTH * k + 2, JOINTS * sizeof *q);
                pose[total++] = i;
            }
            if (regular && found == BRANCHES && arm->by_shoulder) regular = 2;  /* each branch has a posture */
        }
    }
    return total;
}

/* The postures of a pose by Newton's method from the closed form's, by branch index; returns -1 if there may be others. */
static int on_branches(const kr_decoupled *arm, double off, const double T[12], const double seed[JOINTS], double *rows) {
    kr_doubt doubt = {0, off, 0};
    const int count = kr_decoupled_solved(arm, T, KR_EXACT, KR_EXACT, seed, &doubt, rows);
    if (doubt.found) return -1;
    for (int i = 0; i < count; i++) {
        double *row = rows + WIDTH * i, start[JOINTS];
        if (row[1] != 0.0 || !(row[0] < BRANCHES)) return -1;
        memcpy(start, row + 2, sizeof start);
        if (!(kr_newton(arm->placements, T, STEPS, row + 2) < KR_EXACT)) return -1;
        for (int j = 0; j < JOINTS; j++) {
            if (!(fabs(row[2 + j] - start[j]) < FAR)) return -1;
            row[2 + j] = kr_wrapped(row[2 + j]);
        }
    }
    kr_sort_by_branch(rows, count);
    return count;
}

void kr_nearly_decoupled_of_each(const kr_decoupled *arm, double off, const double *T, const double *seeds, int count,
                                 double *q, unsigned char *valid, unsigned char *doubtful) {
    double rows[KR_MAX_ROWS * WIDTH];
    for (int i = 0; i < count; i++) {
        const int found = on_branches(arm, off, T + 16 * i, seeds + JOINTS * i, rows);
        doubtful[i] = found < 0;
        kr_by_branch(JOINTS, SLOTS, rows, found < 0 ? 0 : found, q + SLOTS * JOINTS * i, valid + SLOTS * i);
    }
}
