/* The self-motion of an arm with seven revolute joints: the postures of a pose, curve after curve.
 *
 * A curve is followed from a start by its tangent and Newton's method (Burdick, On the inverse kinematics of redundant
 * manipulators: characterization of the self-motion manifolds, ICRA 1989), until it comes back to the start, or ends
 * where it crosses another. Starts that it passes are on it. What is then on no curve starts the next.
 *
 * A curve has a direction: that of the tangent t with det [J; t] > 0. Two curves that almost meet have opposite
 * directions there. Where a curve comes to a start of another, one of them has left its own; so it has where it comes
 * twice to the same start, or ends at a posture that is not singular. It is followed again by shorter steps; if it still
 * comes to the other, so is that. */
#include "chain.h"
#include "core.h"
#include "self_motion.h"

#include <math.h>
#include <string.h>

enum { N = KR_SEVEN };
/* Longest and shortest step [rad], and most steps one way. */
static const double LONGEST = 0.1, SHORTEST = 1e-6;
enum { MAX_STEPS = 16000 };
/* By how much shorter the steps are where a curve was left, and how often. */
static const double SHORTER = 4.0;
enum { TRIES = 3 };
/* Steps of Newton's method to get back to a curve; and a posture is on one if it misses the pose by less [m, rad]. */
enum { STEPS = 4 };
static const double ON_CURVE = 1e-10;
/* Smallest singular value up to which a curve may end at a posture. */
static const double END = 1e-4;
/* Two postures nearer than this are one [rad]. */
static const double SAME = 1e-5;
/* Cosine between the tangents at both ends of a step; and how far a curve that bends by that is beside its tangent, in
 * shares of the step, and a little more. */
static const double STRAIGHT = 0.97, ASIDE = 0.15;
/* A posture is near a step if it is nearer to its middle, in shares of the step, and a little more. */
static const double NEAR = 0.65;

typedef struct {
    const double *A, *T;
    const double *starts;    /* (count, 7), in [-pi, pi], sorted by joint 1 */
    int count;
    int *mark, *when;        /* the curve that a start is on, or NONE; and after how many of its samples it came there */
    int *closed;             /* of each curve: 1, 0, or LEFT */
} motion_t;

enum { NONE = -1, LEFT = -1 };

/* How a curve ended. */
typedef enum { CLOSED, ENDED, LOST, MET } end_t;

static double difference(double a, double b) { return kr_wrapped(a - b); }

static double dot(const double a[N], const double b[N]) {
    double s = 0.0;
    for (int j = 0; j < N; j++) s += a[j] * b[j];
    return s;
}

/* First start whose joint 1 is not less than an angle. */
static int first_from(const motion_t *m, double angle) {
    int low = 0, high = m->count;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (m->starts[N * middle] < angle) low = middle + 1;
        else high = middle;
    }
    return low;
}

/* One step along a curve: from q along the unit tangent `way` by `length`, to `there`, where the tangent is `ahead`. */
typedef struct {
    double q[N], way[N], there[N], ahead[N], length;
    int forwards;  /* whether det [J; way] > 0 */
} step_t;

/* Where a curve is expected between the ends of a step, as far along its first tangent: a cubic. */
static void between(const step_t *s, double along, double there[N]) {
    const double u = along / s->length, cosine = dot(s->ahead, s->way);
    for (int j = 0; j < N; j++) {
        const double aside = difference(s->there[j], s->q[j]) - s->length * s->way[j];
        const double slope = s->length * (s->ahead[j] / cosine - s->way[j]);
        there[j] = s->q[j] + along * s->way[j] + u * u * ((3.0 - 2.0 * u) * aside + (u - 1.0) * slope);
    }
}

/* Whether a curve passes a posture on a step, farther than `least`. */
static int passes(const motion_t *m, const step_t *s, const double posture[N], double least) {
    double away[N], there[N];
    int sign;
    for (int j = 0; j < N; j++) away[j] = difference(posture[j], s->q[j]);
    const double along = dot(away, s->way);
    if (!(least < along && along < s->length + 0.1 * SAME)) return 0;
    between(s, along, there);
    const int same = kr_contracts(m->A, m->T, s->way, there, posture, &sign);
    if (sign != (s->forwards ? 1 : -1)) return 0;
    if (same) return 1;
    if (!(kr_across(m->A, m->T, s->way, STEPS, there) < ON_CURVE)) return 0;
    for (int j = 0; j < N; j++)
        if (!(fabs(difference(there[j], posture[j])) < SAME)) return 0;
    return 1;
}

/* Mark the starts that curve `me` passes on a step to its sample number `sample`. Returns CLOSED if `first` is one of
 * them, MET at one of another curve, which `other` gets, LOST at one where it has been, else ENDED. */
static end_t mark_passed(const motion_t *m, int me, int first, int sample, const step_t *s, int *other) {
    double middle[N];
    const double width = NEAR * s->length + SAME;
    end_t end = ENDED;
    for (int j = 0; j < N; j++) middle[j] = kr_wrapped(0.5 * (s->q[j] + s->there[j]));
    for (int turn = -1; turn <= 1; turn++) {
        const double at = middle[0] + turn * KR_TURN;
        if (!(-KR_PI - width <= at && at <= KR_PI + width)) continue;
        for (int k = first_from(m, at - width); k < m->count && m->starts[N * k] <= at + width; k++) {
            const double *posture = m->starts + N * k;
            int near = 1;
            for (int j = 1; j < N && near; j++) near = fabs(difference(posture[j], middle[j])) <= width;
            if (!near) continue;
            const double least = sample != 1 ? -0.1 * SAME : k == first ? 0.5 * SAME : -SAME;
            if (!passes(m, s, posture, least)) continue;
            if (k == first) {
                end = CLOSED;
            } else if (m->mark[k] == me) {
                if (sample - m->when[k] > 2 && end == ENDED) end = LOST;
            } else if (m->mark[k] != NONE && m->closed[m->mark[k]] != LEFT) {
                if (end == ENDED) end = MET;
                *other = m->mark[k];
            } else {
                m->mark[k] = me;
                m->when[k] = sample;
            }
        }
    }
    return end;
}

/* The posture that is expected after a step from s->q: the cubic that has come there from the posture before by d, with
 * the tangents at both, goes on. */
static void ahead_of(const step_t *s, const double before[N], const double d[N], double there[N]) {
    const double gone = sqrt(dot(d, d)), u = gone > 0.0 ? s->length / gone : 0.0;
    double aside[N];
    for (int j = 0; j < N; j++) {
        const double sum = s->way[j] + before[j] - (gone > 0.0 ? 2.0 * d[j] / gone : 0.0);
        const double bend = sum + s->way[j] - (gone > 0.0 ? d[j] / gone : 0.0);
        aside[j] = gone > 0.0 ? s->length * u * (bend + u * sum) : 0.0;
    }
    const double along = dot(aside, s->way);
    for (int j = 0; j < N; j++) there[j] = s->q[j] + (s->length - along) * s->way[j] + aside[j];
}

/* Follow curve `me` from start `first` one way, at most `room` samples; the start itself is the first. Returns how many
 * there are; `end` gets how it ended, `other` the curve that it met. */
static int followed(const motion_t *m, int me, int first, double longest, int forwards, int room, double *samples,
                    double *tangents, end_t *end, int *other) {
    double before[N] = {0.0}, came[N] = {0.0};
    const double sense = forwards ? 1.0 : -1.0;
    step_t s = {.length = 0.5 * longest, .forwards = forwards};
    int count = 1;
    *end = LOST;
    if (room < 1) return 0;
    if (!kr_tangent(m->A, m->starts + N * first, tangents)) memset(tangents, 0, N * sizeof *tangents);
    for (int j = 0; j < N; j++) {
        s.q[j] = samples[j] = m->starts[N * first + j];
        s.way[j] = sense * tangents[j];
    }
    for (int k = 0; k < MAX_STEPS && count < room && s.length > SHORTEST; k++) {
        double beside = 0.0;
        int sign;
        ahead_of(&s, before, came, s.there);
        const double missed = kr_step_along(m->A, m->T, s.way, STEPS, s.there, s.ahead, &sign);
        for (int j = 0; j < N; j++) {
            const double aside = s.there[j] - s.q[j] - s.length * s.way[j];
            beside += aside * aside;
        }
        if (!(missed < ON_CURVE && beside < ASIDE * ASIDE * s.length * s.length)
            || sign != (forwards ? 1 : -1) || !(dot(s.ahead, s.way) > STRAIGHT)) {
            s.length *= 0.5;
            continue;
        }
        const end_t passed = mark_passed(m, me, first, count, &s, other);
        if (passed == CLOSED || passed == LOST) {
            *end = passed;
            return count;
        }
        for (int j = 0; j < N; j++) {
            came[j] = s.there[j] - s.q[j];
            before[j] = s.way[j];
            s.q[j] = samples[N * count + j] = s.there[j];
            s.way[j] = s.ahead[j];
            tangents[N * count + j] = sense * s.ahead[j];
        }
        count++;
        if (passed == MET) {
            *end = MET;
            return count;
        }
        s.length = fmin(longest, 1.3 * s.length);
    }
    if (s.length <= SHORTEST && kr_least_of_seven(m->A, s.q) < END) *end = ENDED;
    return count;
}

static void reverse(double *rows, int count) {
    for (int a = 0, b = count - 1; a < b; a++, b--)
        for (int j = 0; j < N; j++) {
            const double t = rows[N * a + j];
            rows[N * a + j] = rows[N * b + j];
            rows[N * b + j] = t;
        }
}

/* Take curve `me` away from its starts. */
static void forget(const motion_t *m, int me) {
    for (int k = 0; k < m->count; k++)
        if (m->mark[k] == me) m->mark[k] = NONE;
}

/* Whether a posture is on a curve with these samples: a cubic between two of them, and back to the pose. */
static int on_curve(const double *A, const double *T, const double *samples, const double *tangents, int count, int closed,
                    const double q[N]) {
    for (int i = 0; i < count - !closed || (count == 1 && i == 0); i++) {
        const double *begin = samples + N * i, *end = samples + N * (i + 1 < count ? i + 1 : 0);
        const double *out = tangents + N * i, *into = tangents + N * (i + 1 < count ? i + 1 : 0);
        double away[N], here[N], square = 0.0, off = 0.0;
        const double first = fabs(difference(q[0], begin[0]));
        if (first > LONGEST + 0.1) continue;
        for (int j = 0; j < N; j++) {
            away[j] = difference(end[j], begin[j]);
            here[j] = difference(q[j], begin[j]);
            square += away[j] * away[j];
            off += (here[j] - 0.5 * away[j]) * (here[j] - 0.5 * away[j]);
        }
        if (!(off <= 0.4 * square + SAME * SAME)) continue;
        const double length = sqrt(square), least = fmax(length, SHORTEST);
        double across[N], there[N];
        for (int j = 0; j < N; j++) across[j] = length > 0.0 ? away[j] / least : out[j];
        const double u = fmin(fmax(dot(here, across) / least, 0.0), 1.0);
        for (int j = 0; j < N; j++) {
            there[j] = u * u * (3.0 - 2.0 * u) * away[j];
            there[j] += length * u * (1.0 - u) * ((1.0 - u) * out[j] - u * into[j]);
            here[j] -= there[j];
        }
        const double along = dot(here, across);
        for (int j = 0; j < N; j++) there[j] += begin[j] + along * across[j];
        kr_across(A, T, across, STEPS, there);
        int same = 1;
        for (int j = 0; j < N && same; j++) same = fabs(difference(there[j], q[j])) < SAME;
        if (same) return 1;
    }
    return 0;
}

void kr_on_curve(const double A[KR_LOOP], const double T[12], const double *samples, const double *tangents, int count,
                 int closed, const double *q, int others, unsigned char *on) {
    for (int i = 0; i < others; i++) on[i] = on_curve(A, T, samples, tangents, count, closed, q + N * i) != 0;
}

/* Follow curve `me` from a start both ways, by steps as long as `shortness` says or shorter until nothing is wrong.
 * Returns how many samples it has; `shortness` gets what was needed, `met` the curves that both ends met, or NONE. */
static int traced(const motion_t *m, int me, int first, int *shortness, int room, double *samples, double *tangents,
                  int met[2]) {
    int size = 0, back = 0;
    for (int k = *shortness; k < TRIES; k++) {
        const double longest = LONGEST / pow(SHORTER, k);
        end_t end, begin = ENDED;
        *shortness = k;
        met[0] = met[1] = NONE;
        forget(m, me);
        m->mark[first] = me;
        m->when[first] = back = 0;
        size = followed(m, me, first, longest, 1, room, samples, tangents, &end, met);
        m->closed[me] = end == CLOSED;
        if (end == CLOSED) break;
        back = followed(m, me, first, longest, 0, room - size, samples + N * size, tangents + N * size, &begin, met + 1);
        if (end == ENDED && begin == ENDED) break;
    }
    if (back < 2) return size;
    reverse(samples, size + back);
    reverse(tangents, size + back);
    reverse(samples + N * (back - 1), size + 1);  /* the start was in both parts */
    reverse(tangents + N * (back - 1), size + 1);
    return size + back - 1;
}

/* Whether a start is on one of the first `curves` curves that was not left. */
static int on_any(const motion_t *m, int start, int curves, const double *samples, const double *tangents,
                  const int *ends) {
    for (int c = 0; c < curves; c++) {
        const int begin = c ? ends[c - 1] : 0;
        if (m->closed[c] != LEFT
            && on_curve(m->A, m->T, samples + N * begin, tangents + N * begin, ends[c] - begin, m->closed[c],
                        m->starts + N * start))
            return 1;
    }
    return 0;
}

/* Whether curve `me`, the last one, is a part of others: all starts that it passes are on them. */
static int part_of_others(const motion_t *m, int me, const double *samples, const double *tangents, const int *ends) {
    for (int k = 0; k < m->count; k++)
        if (m->mark[k] == me && !on_any(m, k, me, samples, tangents, ends)) return 0;
    return 1;
}

int kr_self_motion(const double A[KR_LOOP], const double T[12], const double *starts, int count, int room, double *samples,
                   double *tangents, int *ends, int *closed, int *marks) {
    const motion_t m = {A, T, starts, count, marks, marks + count, closed};
    int *shortness = marks + 2 * count, curves = 0, total = 0;
    for (int k = 0; k < count; k++) m.mark[k] = NONE;
    for (int first = 0; first < count && curves < 2 * count && total < room;) {
        int met[2], again = 0;
        if (m.mark[first] != NONE || on_any(&m, first, curves, samples, tangents, ends)) {
            first++;
            continue;
        }
        shortness[curves] = 0;
        for (;;) {
            int changed = 0;
            closed[curves] = 0;
            ends[curves] = total + traced(&m, curves, first, shortness + curves, room - total, samples + N * total,
                                          tangents + N * total, met);
            for (int k = 0; k < 2; k++)
                if (met[k] != NONE && shortness[met[k]] < TRIES - 1 && closed[met[k]] != LEFT) {
                    forget(&m, met[k]);
                    closed[met[k]] = LEFT;
                    changed = again = 1;
                }
            if (!changed) break;
        }
        if (met[0] != NONE && met[1] != NONE && part_of_others(&m, curves, samples, tangents, ends))
            closed[curves] = LEFT;
        total = ends[curves++];
        first = again ? 0 : first + 1;
    }
    return curves;
}
