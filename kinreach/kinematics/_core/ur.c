/* Closed-form inverse kinematics of UR-type arms.
 *
 * The arm is a turning shoulder, a planar two-link arm with three parallel axes, and two wrist axes. With P5 the origin
 * of wrist_3's axis, Z = (s1, -c1, 0) the normal of the arm's plane and n, o, a the columns of the flange:
 *
 *   shoulder   P5 . Z = d4, a quadratic in q1 (two values);
 *   wrist      cos q5 = a . Z, (cos q6, sin q6) sin q5 = (n . Z, -o . Z) (two values);
 *   elbow      the law of cosines in the plane (two values).
 *
 * That makes eight branches; the index is 4 * shoulder + 2 * wrist + elbow, with wrist 0 for q5 >= 0 and elbow 0 for
 * q3 >= 0. It follows a posture continuously as long as no singularity is crossed.
 *
 * Singular cases, where branches meet or a joint becomes free, are solved, not avoided:
 *
 *   arguments that leave their domain by rounding are clamped where the geometry is missed by no more than `tol`;
 *   at sin q5 = 0 only q234 +- q6 is given. q6 starts from the caller's value and is moved to the nearest angle from
 *   which the elbow can reach: as q6 turns, wrist_1's origin runs on a circle of radius d5 about P5, and the part of it
 *   between the folded and the stretched elbow is one interval of |eta|, bounded by two arccosines. If neither bound is
 *   0 or pi that is two arcs, and each has a posture.
 *
 * Every solution in which something was clamped or moved is checked by forward kinematics. */
#include "core.h"

#include "arctangent.h"
#include "chain.h"
#include "pitches.h"
#include "rows.h"

#include <math.h>
#include <string.h>

enum { SHOULDER_CYLINDER = 1, ELBOW_OUT = 2, ELBOW_IN = 4, RESIDUAL = 8 };  /* parts that miss */
enum { BRANCHES = 8, WIDTH = 8 };
/* Below this sin q5 rounding in the pose, 1e-13 say, is magnified to more than the smallest tolerance. */
static const double NEAR_WRIST = 1e-3;
/* Two values of the shoulder or the elbow that differ by less are one [rad]: rounding of 1e-13 in the pose parts those of
 * a singular posture by up to this, and what is in the middle between them is off by 1e-12 of an arm's length. */
static const double MERGED = 1e-6;
/* Values of a free q234 that are tried on a full turn, and around the best of them in each further round. */
enum { TRIED = 8192, TRIED_AROUND = 128, ROUNDS = 5 };

/* Postures that are being collected. */
typedef struct {
    double *rows;
    int count, miss;
} found_t;

/* Pose of the flange in the DH base frame, T (3, 4), for a posture. */
static void ur_fk(const kr_ur *g, const double q[6], double T[12]) {
    const double s1 = sin(q[0]), c1 = cos(q[0]), s5 = sin(q[4]), c5 = cos(q[4]), s6 = sin(q[5]), c6 = cos(q[5]);
    const double s = sin(q[1] + q[2] + q[3]), c = cos(q[1] + q[2] + q[3]);
    /* along the arm's plane and its normal, then u along (c1, s1, 0), v along z, w along the normal (s1, -c1, 0) */
    const double n_plane = c6 * c5, n_normal = c6 * s5, o_plane = -s6 * c5, o_normal = -s6 * s5;
    const double n_u = n_plane * c - s6 * s, n_v = n_plane * s + s6 * c;
    const double o_u = o_plane * c - c6 * s, o_v = o_plane * s + c6 * c;
    const double a_u = -s5 * c, a_v = -s5 * s;
    const double u = -g->upper * cos(q[1]) - g->fore * cos(q[1] + q[2]) + g->d5 * s + g->d6 * a_u;
    const double v = -g->upper * sin(q[1]) - g->fore * sin(q[1] + q[2]) - g->d5 * c + g->d6 * a_v + g->d1;
    const double w = g->d4 + g->d6 * c5;
    T[0] = n_u * c1 + n_normal * s1, T[1] = o_u * c1 + o_normal * s1, T[2] = a_u * c1 + c5 * s1, T[3] = u * c1 + w * s1;
    T[4] = n_u * s1 - n_normal * c1, T[5] = o_u * s1 - o_normal * c1, T[6] = a_u * s1 - c5 * c1, T[7] = u * s1 - w * c1;
    T[8] = n_v, T[9] = o_v, T[10] = a_v, T[11] = v;
}

static double longest(double x, double y, double z) { return sqrt(x * x + y * y + z * z); }

/* Position [m], or the largest difference of a rotation's entry. */
static double pose_missed_by(const kr_ur *g, const double q[6], const double P[12]) {
    double T[12];
    ur_fk(g, q, T);
    double most = longest(T[3] - P[3], T[7] - P[7], T[11] - P[11]);
    for (int k = 0; k < 12; k++)
        if (k % 4 != 3) most = fmax(most, fabs(T[k] - P[k]));
    return most;
}

/* Position [m] of a point on the tool's axis, or the direction's error [rad]. */
static double axis_missed_by(const kr_ur *g, const double q[6], const double P[12], double reach) {
    double T[12];
    ur_fk(g, q, T);
    const double off = longest(T[3] + reach * T[2] - P[3], T[7] + reach * T[6] - P[7], T[11] + reach * T[10] - P[11]);
    return fmax(off, longest(T[2] - P[2], T[6] - P[6], T[10] - P[10]));
}

/* Sines and cosines of q1 from x sin q1 - y cos q1 = d4; returns how many values there are. */
static int shoulders(double x, double y, double d4, double tol, double s1[2], double c1[2]) {
    const double r2 = x * x + y * y, m2 = r2 - d4 * d4;
    if (m2 > MERGED * MERGED * r2) {
        const double d = d4 / r2, m = sqrt(m2) / r2, xd = x * d, yd = y * d, xm = x * m, ym = y * m;
        s1[0] = xd + ym, c1[0] = xm - yd;
        s1[1] = xd - ym, c1[1] = -yd - xm;
        return 2;
    }
    const double r = sqrt(r2);
    if (!(r >= d4 - tol)) return 0;
    s1[0] = x / r, c1[0] = -y / r;
    return 1;
}

static void add(found_t *found, int branch, int flags, double q1, double q2, double q3, double q4, double q5, double q6) {
    double *row = found->rows + WIDTH * found->count++;
    row[0] = branch, row[1] = flags;
    row[2] = q1, row[3] = q2, row[4] = q3, row[5] = q4, row[6] = q5, row[7] = q6;
}

/* Wrist_1 -> shoulder points along phi, and is turned by psi >= 0 against the upper arm. */
static void add_both_elbows(found_t *found, int branch, int flags, double q1, double q5, double q6, double q234, double q3,
                            double phi, double psi, int bent) {
    const double rest = q234 - phi, bend = psi - q3;
    add(found, branch, flags, q1, kr_wrapped(phi - psi), q3, kr_wrapped(rest + bend), q5, q6);
    if (bent) add(found, branch + 1, flags, q1, kr_wrapped(phi + psi), -q3, kr_wrapped(rest - bend), q5, q6);
}

/* Add both postures of the elbow, from -u = a2 c2 + a3 c23 and -v = a2 s2 + a3 s23: (u, v) points from wrist_1 to the
 * shoulder, in the arm's plane [m]. */
static void add_elbows(const kr_ur *g, double tol, found_t *found, int branch, int flags, double q1, double q5, double q6,
                       double q234, double u, double v) {
    const double square = u * u + v * v;
    double c3 = (square - g->upper * g->upper - g->fore * g->fore) / (2.0 * g->upper * g->fore);
    double s3 = -1.0 < c3 && c3 < 1.0 ? sqrt(1.0 - c3 * c3) : 0.0;
    if (s3 < MERGED) {
        const double rho = sqrt(square);
        if (rho > g->stretched + tol || rho < g->folded - tol) {
            found->miss |= rho > g->stretched + tol ? ELBOW_OUT : ELBOW_IN;
            return;
        }
        c3 = copysign(1.0, c3), s3 = 0.0, flags |= KR_ELBOW;
    }
    const double q3 = kr_atan2(s3, c3), phi = kr_atan2(v, u), psi = kr_atan2(g->fore * s3, g->upper + g->fore * c3);
    add_both_elbows(found, branch, flags, q1, q5, q6, q234, q3, phi, psi, s3 > 0.0);
}

/* `kr_pitches` of P5 at (u, v) from the shoulder [m]: the hand is d5, below it. */
static int pitches(const kr_ur *g, double wanted, double u, double v, kr_pitch arcs[2]) {
    return kr_pitches(wanted, u, v, g->d5, -0.5 * KR_PI, g->stretched, g->folded, arcs);
}

/* Both wrists where sin q5 is so small that q6 and q234, each by itself, are inexact. Exact is their sum, where q5 is
 * near pi their difference. If the elbow reaches only from a little beside that q234, no further than tol / s5, q234 is
 * moved there, and q6 with it. */
static void add_near_wrists(const kr_ur *g, double tol, found_t *found, int branch, int flags, double q1, double q5,
                            double q6, double s5, double total, double u, double v) {
    for (int side = 0; side < 2; side++) {
        const int straight = q5 < 0.5 * KR_PI;
        const double wanted = kr_wrapped(straight ? total - q6 : total + q6);
        kr_pitch arcs[2];
        int moved = 0;
        pitches(g, wanted, u, v, arcs);
        double q234 = arcs[0].pitch;
        if (fabs(q234 - wanted) > tol / s5)
            q234 = wanted;
        else if (q234 != wanted) {
            moved = KR_WRIST | KR_MOVED;
            q6 = straight ? total - q234 : q234 - total;
        }
        const double s = g->d5 * sin(q234), c = g->d5 * cos(q234);
        add_elbows(g, tol, found, branch + 2 * side, flags | moved, q1, side ? -q5 : q5, kr_wrapped(q6), kr_wrapped(q234),
                   s - u, -c - v);
        q6 += q6 <= 0.0 ? KR_PI : -KR_PI;
    }
}

/* The wrist at sin q5 = 0: a posture on each arc of pitches. `angle` is what q234 and q6 have to add up to, or differ by,
 * up to pi; without it q6 is what it is. */
static void add_free_wrists(const kr_ur *g, double tol, found_t *found, int branch, int flags, double q1, int straight,
                            double wanted, const double *angle, double q6, double u, double v) {
    kr_pitch arcs[2];
    const int count = pitches(g, wanted, u, v, arcs);
    for (int k = 0; k < count; k++) {
        const double q234 = arcs[k].pitch, s = g->d5 * sin(q234), c = g->d5 * cos(q234);
        if (angle) q6 = kr_wrapped(straight ? *angle - q234 : q234 - *angle + KR_PI);
        add_elbows(g, tol, found, branch + arcs[k].side, flags | arcs[k].flags, q1, straight ? 0.0 : KR_PI, q6, q234,
                   s - u, -c - v);
    }
}

/* Drop the solutions in which something was clamped or moved and that do not reach. */
static int verified(const kr_ur *g, const double P[12], double reach, int axis, double tol, found_t *found, int *miss) {
    int kept = 0;
    const int count = found->count;
    for (int i = 0; i < count; i++) {
        const double *row = found->rows + WIDTH * i;
        if (row[1] != 0.0) {
            const double off = axis ? axis_missed_by(g, row + 2, P, reach) : pose_missed_by(g, row + 2, P);
            if (!(off <= tol)) continue;
        }
        if (kept < i) memcpy(found->rows + WIDTH * kept, row, WIDTH * sizeof *row);
        kept++;
    }
    if (kept < count) found->miss |= RESIDUAL;
    *miss = count || found->miss ? found->miss : SHOULDER_CYLINDER;
    return kept;
}

/* Every posture of a pose P of the flange at which nothing is singular, all arctangents of a kind together: by the formulas
 * of `flange_postures`, to the bit. Returns -1 where something is singular, or almost. */
static int regular_postures(const kr_ur *g, const double P[12], double tol, double *rows, int *miss) {
    const double x = P[3] - g->d6 * P[2], y = P[7] - g->d6 * P[6], z = P[11] - g->d6 * P[10] - g->d1;
    double sine[8], cosine[8], wrist[8]; /* of q1, q5, q6 and q234, each for both shoulders */
    double above[12], along[12], elbow[12], u[4], v[4]; /* q3, phi and psi, each for four wrists */
    int far[4] = {0};
    if (shoulders(x, y, g->d4, tol, sine, cosine) < 2) return -1;
    for (int k = 0; k < 2; k++) {
        const double s1 = sine[k], c1 = cosine[k], u1 = -x * c1 - y * s1;
        const double c6 = P[0] * s1 - P[4] * c1, s6 = P[5] * c1 - P[1] * s1, s5 = sqrt(c6 * c6 + s6 * s6);
        if (!(s5 > NEAR_WRIST && s5 > tol)) return -1;
        const double h = g->d5 / s5, s = h * P[10], c = h * (P[2] * c1 + P[6] * s1);
        sine[2 + k] = s5, cosine[2 + k] = P[2] * s1 - P[6] * c1;
        sine[4 + k] = s6, cosine[4 + k] = c6;
        sine[6 + k] = -s, cosine[6 + k] = -c;
        u[2 * k] = u1 - s, v[2 * k] = c - z;
        u[2 * k + 1] = u1 + s, v[2 * k + 1] = -c - z;
    }
    *miss = 0;
    for (int w = 0; w < 4; w++) {
        const double square = u[w] * u[w] + v[w] * v[w];
        const double c3 = (square - g->upper * g->upper - g->fore * g->fore) / (2.0 * g->upper * g->fore);
        const double s3 = -1.0 < c3 && c3 < 1.0 ? sqrt(1.0 - c3 * c3) : 0.0;
        if (!(s3 >= MERGED)) {
            const double rho = sqrt(square);
            if (!(rho > g->stretched + tol || rho < g->folded - tol)) return -1;
            *miss |= far[w] = rho > g->stretched + tol ? ELBOW_OUT : ELBOW_IN;
        }
        above[w] = s3, along[w] = c3;
        above[4 + w] = v[w], along[4 + w] = u[w];
        above[8 + w] = g->fore * s3, along[8 + w] = g->upper + g->fore * c3;
    }
    kr_atan2_of_each(8, sine, cosine, wrist);
    kr_atan2_of_each(12, above, along, elbow);
    found_t found = {rows, 0, 0};
    for (int w = 0; w < 4; w++) {
        if (far[w]) continue;
        const int k = w / 2, flipped = w % 2;
        double q6 = wrist[4 + k], q234 = wrist[6 + k];
        if (flipped) q6 += q6 <= 0.0 ? KR_PI : -KR_PI, q234 += q234 <= 0.0 ? KR_PI : -KR_PI;
        add_both_elbows(&found, 2 * w, 0, wrist[k], flipped ? -wrist[2 + k] : wrist[2 + k], q6, q234, elbow[w], elbow[4 + w],
                        elbow[8 + w], 1);
    }
    return found.count;
}

/* Every posture that puts the flange at a pose P in the DH base frame. A free q6 stays near the given one. */
static int flange_postures(const kr_ur *g, const double P[12], double tol, double q6, double *rows, int *miss) {
    const double nx = P[0], ox = P[1], ax = P[2], ny = P[4], oy = P[5], ay = P[6], nz = P[8], oz = P[9], az = P[10];
    const double x = P[3] - g->d6 * ax, y = P[7] - g->d6 * ay, z = P[11] - g->d6 * az - g->d1;
    found_t found = {rows, 0, 0};
    double sines[2], cosines[2];
    const int sides = shoulders(x, y, g->d4, tol, sines, cosines);
    for (int k = 0; k < sides; k++) {
        const int branch = 4 * k, flags = sides == 1 ? KR_SHOULDER : 0;
        const double s1 = sines[k], c1 = cosines[k], q1 = kr_atan2(s1, c1), u = -x * c1 - y * s1;
        const double c6 = nx * s1 - ny * c1, s6 = oy * c1 - ox * s1, c5 = ax * s1 - ay * c1;
        const double s5 = sqrt(c6 * c6 + s6 * s6);
        if (s5 > NEAR_WRIST && s5 > tol) {
            const double h = g->d5 / s5, s = h * az, c = h * (ax * c1 + ay * s1);
            double q5 = kr_atan2(s5, c5), q6_ = kr_atan2(s6, c6), q234 = kr_atan2(-s, -c);
            add_elbows(g, tol, &found, branch, flags, q1, q5, q6_, q234, u - s, c - z);
            /* the flipped wrist is -q5, q6 + pi, q234 + pi */
            q6_ += q6_ <= 0.0 ? KR_PI : -KR_PI;
            q234 += q234 <= 0.0 ? KR_PI : -KR_PI;
            add_elbows(g, tol, &found, branch + 2, flags, q1, -q5, q6_, q234, u + s, -c - z);
        } else if (s5 > tol) {
            const double n_u = nx * c1 + ny * s1, o_u = ox * c1 + oy * s1;
            const double total = c5 > 0.0 ? kr_atan2(nz - o_u, n_u + oz) : kr_atan2(-nz - o_u, oz - n_u);
            add_near_wrists(g, tol, &found, branch, flags, q1, kr_atan2(s5, c5), kr_atan2(s6, c6), s5, total, -u, z);
        } else if (s5 <= tol) {
            /* n lies in the arm's plane, at the angle q234 + q6 (q5 = 0) or q234 - q6 + pi (q5 = pi) */
            const double angle = kr_atan2(nz, nx * c1 + ny * s1);
            const double wanted = c5 > 0.0 ? angle - q6 : angle + q6 - KR_PI;
            add_free_wrists(g, tol, &found, branch, flags, q1, c5 > 0.0, wanted, &angle, 0.0, -u, z);
        }
    }
    return verified(g, P, 0.0, 0, tol, &found, miss);
}

int kr_ur_axis_postures(const kr_ur *g, const double P[12], double reach, double pitch, double q6, double tol,
                        double *rows, int *miss) {
    /* rotation about the tool is q6's alone; with a = c5 Z - s5 X the direction gives q5 and q234 */
    const double ax = P[2], ay = P[6], az = P[10], length = g->d6 + reach;
    const double x = P[3] - length * ax, y = P[7] - length * ay, z = P[11] - length * az - g->d1;
    found_t found = {rows, 0, 0};
    double sines[2], cosines[2];
    const int sides = shoulders(x, y, g->d4, tol, sines, cosines);
    for (int k = 0; k < sides; k++) {
        const int branch = 4 * k, flags = sides == 1 ? KR_SHOULDER : 0;
        const double s1 = sines[k], c1 = cosines[k], q1 = kr_atan2(s1, c1), u = -x * c1 - y * s1;
        const double a_u = ax * c1 + ay * s1, c5 = ax * s1 - ay * c1, s5 = sqrt(a_u * a_u + az * az);
        if (s5 > tol) {
            const double s = az * g->d5 / s5, c = a_u * g->d5 / s5, q5 = kr_atan2(s5, c5);
            double q234 = kr_atan2(-s, -c);
            add_elbows(g, tol, &found, branch, flags, q1, q5, q6, q234, u - s, c - z);
            q234 += q234 <= 0.0 ? KR_PI : -KR_PI;
            add_elbows(g, tol, &found, branch + 2, flags, q1, -q5, q6, q234, u + s, -c - z);
        } else if (s5 <= tol) {
            add_free_wrists(g, tol, &found, branch, flags, q1, c5 > 0.0, pitch, NULL, q6, -u, z);
        }
    }
    return verified(g, P, reach, 1, tol, &found, miss);
}

/* The postures of one shoulder with a free wrist_3. */
typedef struct {
    const kr_ur *ur;
    const kr_arm *arm;
    const double *seed;
    int straight;       /* q5 is 0, else pi */
    double q1, angle;   /* what q234 and q6 have to add up to, or differ by, up to pi */
    double u, v;        /* from P5 to the shoulder, in the arm's plane [m] */
} family_t;

/* The member at q234 with one value of the elbow, in windings within the limits; returns 0 if it is not allowed. */
static int member(const family_t *f, double q234, int elbow, double *q) {
    double rows[2 * WIDTH];
    found_t found = {rows, 0, 0};
    const double s = f->ur->d5 * sin(q234), c = f->ur->d5 * cos(q234);
    add_elbows(f->ur, 0.0, &found, 0, 0, f->q1, f->straight ? 0.0 : KR_PI, f->straight ? f->angle - q234 : q234 - f->angle + KR_PI,
               q234, f->u + s, f->v - c);
    if (found.count <= elbow) return 0;
    return kr_wound(6, rows + WIDTH * elbow + 2, f->seed, f->arm->lower, f->arm->upper, 1e-3, q);
}

/* The allowed member of an arc whose q6 is nearest to the seed's; returns 0 if there is none. One that is allowed within
 * less than a step of q234 may be missed. */
static int nearest_member(const family_t *f, int two_arcs, int side, int elbow, double *best) {
    double begin = -KR_PI, end = KR_PI, q[6];
    int steps = TRIED;
    for (int round = 0; round < ROUNDS; round++, steps = TRIED_AROUND) {
        const double width = (end - begin) / steps;
        double least = INFINITY, at = 0.0;
        for (int i = 0; i <= steps; i++) {
            const double q234 = begin + width * i;
            if (two_arcs && !round && (kr_wrapped(q234 + kr_atan2(-f->u, -f->v)) < 0.0) != (side > 0)) continue;
            if (!member(f, q234, elbow, q)) continue;
            const double away = fabs(q[5] - f->seed[5]);
            if (away < least) least = away, at = q234, memcpy(best, q, sizeof q);
        }
        if (least == INFINITY) return round > 0;
        begin = fmax(begin, at - width), end = fmin(end, at + width);
    }
    return 1;
}

/* Replace or add, by branch, the postures of a free wrist_3 that are within the limits and nearest to the seed. */
static int add_free_wrist_within(const kr_ur *g, const kr_arm *arm, const double P[12], const double *seed, double tol,
                                 double *rows, int count) {
    const double x = P[3] - g->d6 * P[2], y = P[7] - g->d6 * P[6], z = P[11] - g->d6 * P[10] - g->d1;
    double sines[2], cosines[2], best[6];
    const int sides = shoulders(x, y, g->d4, tol, sines, cosines);
    for (int k = 0; k < sides; k++) {
        const double s1 = sines[k], c1 = cosines[k];
        const double c6 = P[0] * s1 - P[4] * c1, s6 = P[5] * c1 - P[1] * s1;
        if (!(sqrt(c6 * c6 + s6 * s6) <= tol)) continue;
        const family_t f = {g, arm, seed, P[2] * s1 - P[6] * c1 > 0.0, kr_atan2(s1, c1), kr_atan2(P[8], P[0] * c1 + P[4] * s1),
                            -x * c1 - y * s1, -z};
        kr_pitch arcs[2];
        const int two = pitches(g, 0.0, -f.u, -f.v, arcs);
        for (int arc = 0; arc < two; arc++)
            for (int elbow = 0; elbow < 2; elbow++) {
                if (!nearest_member(&f, two > 1, arcs[arc].side, elbow, best)) continue;
                if (!(pose_missed_by(g, best, P) <= tol)) continue;
                const int branch = 4 * k + arcs[arc].side + elbow;
                int at = 0;
                while (at < count && rows[WIDTH * at] != branch) at++;
                if (at == BRANCHES) continue;
                if (at == count) count++;
                double *row = rows + WIDTH * at;
                row[0] = branch, row[1] = (sides == 1 ? KR_SHOULDER : 0) | KR_WRIST | KR_MOVED;
                memcpy(row + 2, best, sizeof best);
            }
    }
    return count;
}

int kr_ur_postures(const kr_ur *g, const kr_arm *arm, const double T[16], const double seed[6], double tol, double *rows,
                   int *miss) {
    double P[12], M[12], allowed[6];
    kr_times(g->base, T, M);
    kr_times(M, g->flange, P);
    int count = regular_postures(g, P, tol, rows, miss);
    if (count >= 0) return count;
    count = flange_postures(g, P, tol, seed[5], rows, miss);
    if (!arm || arm->full_turn) return count;
    /* a free wrist_3 gets a value with which the posture is within the limits; what was allowed stays */
    int keep[BRANCHES], blocked = 0;
    double given[BRANCHES * WIDTH];
    for (int i = 0; i < count; i++) {
        const double *row = rows + WIDTH * i;
        keep[i] = !((int)row[1] & KR_WRIST);
        if (keep[i]) continue;
        double F[12 * 7];
        kr_frames(6, arm->placements, row + 2, F);
        keep[i] = kr_allowed(arm, 0, F + 72, row + 2, seed, 1, tol, allowed);
        blocked |= !keep[i];
    }
    if (!blocked) return count;
    const int before = count;
    memcpy(given, rows, sizeof given);
    count = add_free_wrist_within(g, arm, P, seed, tol, rows, count);
    for (int i = 0; i < before; i++)
        if (keep[i]) memcpy(rows + WIDTH * i, given + WIDTH * i, WIDTH * sizeof *rows);
    kr_sort_by_branch(rows, count);
    return count;
}
