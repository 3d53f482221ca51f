/* Closed forms of six-axis arms by the geometry of their axes.
 *
 * With R and P the pose of the last frame as seen from the first, two kinds of arms decouple:
 *
 *   a spherical wrist (axes 4, 5 and 6 meet): P depends on the first three angles only (Pieper, The kinematics of
 *     manipulators under computer control, Stanford 1968);
 *   axes 2, 3 and 4 parallel: they move the wrist in a plane, so that the height of P above it and the direction of axis 6
 *     depend on the angles of joints 1 and 5 only.
 *
 * Three equations are solved again and again (the subproblems of Paden and Kahan; Elias and Wen, IK-Geo: unified robot
 * inverse kinematics using subproblem decomposition, Mechanism and Machine Theory 209, 2025):
 *
 *   shoulder   where axes 2 and 3 are parallel, P has a given height above their plane, which is linear in the cosine and
 *              sine of the first angle;
 *   wrist      a rotation as three turns, of which the middle one is given by one entry;
 *   elbow      two links in a plane, by the law of cosines.
 *
 * Where a spherical wrist comes without parallel axes 2 and 3, or axes 5 and 6 do not meet behind parallel ones, two
 * unknown angles are left in two equations; they are one quadratic equation in the cosine and sine of one angle, with up
 * to four roots.
 *
 * Branch index: 4 for the second shoulder, 2 for a negative wrist angle, 1 for a negative elbow angle, added; where roots
 * of the quadratic equation take the place of two of them, their number counts. What is singular is solved: arguments that
 * leave their domain by rounding are clamped, and an angle that is free takes the caller's value. */
#include "decoupled.h"

#include "arctangent.h"
#include "chain.h"
#include "pitches.h"
#include "sincos.h"

#include <math.h>
#include <string.h>

enum { JOINTS = 6, WIDTH = 8, MOST_POSITIONS = 2 * KR_MAX_ROOTS, MOST_ARCS = 3, MOST_TURNS = 2 * MOST_ARCS };
/* Below this sin q5 rounding in the pose, 1e-13 say, is magnified to more than the smallest tolerance. */
static const double NEAR_WRIST = 1e-3;
/* By this a posture may miss anywhere for the pose to be looked at more closely [m, rad]. */
static const double CLOSE = 1e-5;
/* Roots of the quadratic equation are apart by more than this [rad]. */
static const double APART = 1e-6;
/* Sine between axes that are nearly parallel; turns of the hand that are tried then reach to this one [rad]. */
static const double NEARLY_PARALLEL = 0.3, WIDEST_TURN = 1.4;
enum { HAND_TURNS = 9 };

/* What is asked for, and the postures that are being collected. */
typedef struct {
    const kr_decoupled *arm;
    double pose[12], tol, aligned, start[JOINTS];
    kr_doubt *doubt;
    double *rows;
    int count;
} search_t;

/* P in the plane (u, v) [m], length of the hand and its angle at pitch 0, and the wanted angle of the last joint. */
typedef struct {
    double u, v, hand, angle, last;
} palm_t;

/* A shoulder: q1, P in the plane of joints 2 and 3 [m], and how far that moves with P. */
typedef struct {
    int branch, flags;
    double q1, c1, s1, u, v, gain;
} shoulder_t;

/* Three angles that put P in its place. */
typedef struct {
    int branch, flags;
    double q1, q2, q3;
} position_t;

typedef struct {
    int branch, flags;
    double q2, q3;
} elbow_t;

typedef struct {
    int branch, flags;
    double q4, q5, q6;
} turns_t;

/* Take two postures that meet into account. `sine2` is the square of the sine of half the angle between them, less than 0
 * where they do not exist; `length` what it changes with [m]; `gain` how much of what poses are off arrives here. */
static void folded(kr_doubt *doubt, double sine2, double length, double gain) {
    if (doubt && fabs(sine2) * length < 4.0 * doubt->off * gain) doubt->found = 1;
}

/* Take the sine between the outer axes of a wrist into account. */
static void nearly_aligned(kr_doubt *doubt, double sine, double gain) {
    if (doubt && sine < doubt->off * gain) doubt->found = 1;
}

static void set_free(kr_doubt *doubt, int joint) {
    if (doubt) doubt->free |= 1 << joint;
}

static void add(search_t *s, int branch, int flags, double q1, double q2, double q3, double q4, double q5, double q6) {
    if (s->count == KR_MAX_ROWS) return;
    const double theta[JOINTS] = {q1, q2, q3, q4, q5, q6};
    double *row = s->rows + WIDTH * s->count++;
    row[0] = branch, row[1] = flags;
    for (int j = 0; j < JOINTS; j++) row[2 + j] = kr_wrapped(s->arm->sign[j] * (theta[j] - s->arm->offset[j]));
}

/* A rotation as seen behind a joint with cosine c and sine s, and an angle between axes; the fourth column is not used. */
static void behind(const double in[12], double c, double s, double ca, double sa, double out[12]) {
    for (int k = 0; k < 3; k++) {
        const double x = in[k], y = in[4 + k], z = in[8 + k], t = c * y - s * x;
        out[k] = c * x + s * y;
        out[4 + k] = ca * t + sa * z;
        out[8 + k] = ca * z - sa * t;
    }
}

static void behind_turn(const double in[12], double angle, double ca, double sa, double out[12]) {
    double c, s;
    kr_sincos(angle, &s, &c);
    behind(in, c, s, ca, sa, out);
}

static void cross(const double a[3], const double b[3], double product[3]) {
    product[0] = a[1] * b[2] - a[2] * b[1];
    product[1] = a[2] * b[0] - a[0] * b[2];
    product[2] = a[0] * b[1] - a[1] * b[0];
}

/* The centre of a spherical wrist behind joint 2 [m]. */
static void centre(const kr_decoupled *arm, double c3, double s3, double point[3]) {
    const double along = arm->sine[2] * arm->d[3];
    const double x = c3 * arm->a[2] + s3 * along, y = s3 * arm->a[2] - c3 * along;
    const double z = arm->cosine[2] * arm->d[3] + arm->d[2];
    point[0] = x + arm->a[1];
    point[1] = arm->cosine[1] * y - arm->sine[1] * z;
    point[2] = arm->sine[1] * y + arm->cosine[1] * z + arm->d[1];
}

void kr_decoupled_prepare(kr_decoupled *arm) {
    double shortest = INFINITY, values[3][2];
    for (int k = 0; k < 5; k++) {
        const double c = cos(arm->alpha[k]), s = sin(arm->alpha[k]);
        arm->cosine[k] = fabs(c) < KR_ZERO ? 0.0 : c;
        arm->sine[k] = fabs(s) < KR_ZERO ? 0.0 : s;
        if (fabs(arm->a[k]) > 0.0) shortest = fmin(shortest, fabs(arm->a[k]));
    }
    for (int k = 0; k < JOINTS; k++)
        if (fabs(arm->d[k]) > 0.0) shortest = fmin(shortest, fabs(arm->d[k]));
    const double *a = arm->a, *d = arm->d, *ca = arm->cosine, *sa = arm->sine;
    const int parallel = sa[1] == 0.0 && sa[0] != 0.0;
    arm->size = shortest;
    arm->right_angles = ca[3] == 0.0 && ca[4] == 0.0;
    arm->spherical = a[3] == 0.0 && a[4] == 0.0 && d[4] == 0.0;
    arm->by_shoulder = parallel && (arm->spherical || a[4] == 0.0);
    arm->upper = a[1], arm->hand = arm->hand_angle = 0.0;
    if (arm->spherical) {
        arm->fore = hypot(a[2], sa[2] * d[3]), arm->fore_angle = atan2(-sa[2] * d[3], a[2]);
        arm->height = d[1] + d[2] + ca[2] * d[3];
    } else {
        arm->fore = a[2], arm->fore_angle = 0.0;
        arm->height = d[1] + ca[3] * d[4];
        arm->hand = hypot(a[3], sa[3] * d[4]), arm->hand_angle = atan2(-sa[3] * d[4], a[3]);
    }
    arm->stretched = arm->upper + arm->fore, arm->folded = fabs(arm->upper - arm->fore);
    for (int k = 0; k < 3; k++) {
        double point[3];
        centre(arm, cos(KR_TURN * k / 3.0), sin(KR_TURN * k / 3.0), point);
        values[k][0] = point[0] * point[0] + point[1] * point[1] + point[2] * point[2];
        values[k][1] = point[2];
    }
    for (int which = 0; which < 2; which++) {
        double *to = which ? arm->height_of_point : arm->square_of_point;
        to[0] = to[1] = to[2] = 0.0;
        for (int k = 0; k < 3; k++) {
            to[0] += values[k][which] / 3.0;
            to[1] += 2.0 / 3.0 * cos(KR_TURN * k / 3.0) * values[k][which];
            to[2] += 2.0 / 3.0 * sin(KR_TURN * k / 3.0) * values[k][which];
        }
    }
    arm->length_divisor = arm->sine_divisor = INFINITY;
    if (!arm->spherical && !arm->by_shoulder)
        arm->length_divisor = fabs(a[4]);
    else if (!arm->by_shoulder && !(fabs(a[0]) < KR_ZERO || sa[0] == 0.0))
        arm->length_divisor = fabs(a[0]), arm->sine_divisor = fabs(sa[0]);
}

/* Both shoulders; returns how many there are. */
static int shoulders(const search_t *s, shoulder_t found[2]) {
    const kr_decoupled *arm = s->arm;
    const double x = s->pose[3], y = s->pose[7], z = s->pose[11], a1 = arm->a[0], ca1 = arm->cosine[0], sa1 = arm->sine[0];
    const double across = (ca1 * z - arm->height) / sa1, v = ca1 * across + sa1 * z;
    const double r2 = x * x + y * y, m2 = r2 - across * across, r = sqrt(r2);
    folded(s->doubt, r2 > 0.0 ? m2 / r2 : 0.0, r, 1.0);
    found[0].branch = 0, found[1].branch = 4;
    if (m2 > KR_MERGED * KR_MERGED * r2 + KR_ZERO * KR_ZERO && r2 > s->tol * s->tol) {
        const double along = sqrt(m2), gain = 1.0 + (r + fabs(across)) / along;
        for (int k = 0; k < 2; k++) {
            const double m = k ? -along : along, c1 = (x * m + y * across) / r2, s1 = (y * m - x * across) / r2;
            found[k].flags = 0, found[k].q1 = kr_atan2(s1, c1), found[k].c1 = c1, found[k].s1 = s1;
            found[k].u = m - a1, found[k].v = v, found[k].gain = gain;
        }
        return 2;
    }
    if (!(r >= fabs(across) - fmax(s->tol, CLOSE))) return 0;
    found[0].flags = KR_SHOULDER, found[0].u = -a1, found[0].v = v, found[0].gain = 1.0;
    if (r <= s->tol) {  /* P is on the first axis */
        set_free(s->doubt, 0);
        found[0].q1 = s->start[0], found[0].c1 = cos(s->start[0]), found[0].s1 = sin(s->start[0]);
    } else {
        const double sign = copysign(1.0, across);
        found[0].c1 = sign * y / r, found[0].s1 = -sign * x / r;
        found[0].q1 = atan2(found[0].s1, found[0].c1);
    }
    return 1;
}

/* Both elbows with which two links in the plane reach a point (u, v) [m]; returns how many there are. */
static int elbows(const search_t *s, double u, double v, double gain, elbow_t found[2]) {
    const double upper = s->arm->upper, fore = s->arm->fore, rho2 = u * u + v * v;
    const double c3 = (rho2 - upper * upper - fore * fore) / (2.0 * upper * fore);
    const double s3 = -1.0 < c3 && c3 < 1.0 ? sqrt(1.0 - c3 * c3) : 0.0, rho = sqrt(rho2);
    folded(s->doubt, 1.0 - c3 * c3, upper * fore / s->arm->stretched, gain);
    if (s3 >= KR_MERGED && rho2 > s->tol * s->tol) {
        const double way = kr_atan2(v, u), q3 = kr_atan2(s3, c3), psi = kr_atan2(fore * s3, upper + fore * c3);
        for (int k = 0; k < 2; k++) {
            found[k].branch = k, found[k].flags = 0;
            found[k].q2 = k ? way + psi : way - psi;
            found[k].q3 = (k ? -q3 : q3) - s->arm->fore_angle;
        }
        return 2;
    }
    const double amiss = fmax(s->tol, CLOSE);
    if (!(s->arm->folded - amiss <= rho && rho <= s->arm->stretched + amiss)) return 0;
    if (rho <= s->tol) set_free(s->doubt, 1);
    const double way = rho <= s->tol ? s->start[1] : atan2(v, u);
    const int straight = c3 > 0.0;
    found[0].branch = 0, found[0].flags = KR_ELBOW;
    found[0].q2 = straight || upper >= fore ? way : way + KR_PI;
    found[0].q3 = (straight ? 0.0 : KR_PI) - s->arm->fore_angle;
    return 1;
}

/* The last of three turns, from the first column of their product and the other two. */
static double last_turn(const kr_decoupled *arm, const double n[12], double q4, double q5) {
    const double c4 = cos(q4), s4 = sin(q4), c5 = cos(q5), s5 = sin(q5);
    const double across = c4 * n[4] - s4 * n[0], x4 = c4 * n[0] + s4 * n[4];
    const double y4 = arm->cosine[3] * across + arm->sine[3] * n[8], z4 = arm->cosine[3] * n[8] - arm->sine[3] * across;
    return atan2(arm->cosine[4] * (c5 * y4 - s5 * x4) + arm->sine[4] * z4, c5 * x4 + s5 * y4);
}

/* Pitches of a hand. If it comes to axis 2, to where the elbow folds, joint 2 is free at one more pitch. */
static int hand_pitches(const search_t *s, double wanted, const palm_t *palm, kr_pitch arcs[MOST_ARCS]) {
    const kr_decoupled *arm = s->arm;
    int count = kr_pitches(wanted, palm->u, palm->v, palm->hand, palm->angle, arm->stretched, arm->folded, arcs);
    if (arm->folded <= KR_ZERO && fabs(hypot(palm->u, palm->v) - palm->hand) <= s->aligned) {
        arcs[count].side = 0, arcs[count].flags = KR_WRIST | KR_MOVED;
        arcs[count++].pitch = atan2(palm->v, palm->u) - palm->angle;
    }
    return count;
}

/* The first and the last of three turns n, of which the middle one is q5.
 *
 * Where only the sum of their turns is given, the first one is `first`; or with a palm it is the pitch of this hand, and
 * the last one keeps its value as far as the elbow reaches. Returns how many there are. */
static int outer_turns(const search_t *s, const double n[12], double q5, double first, const palm_t *palm,
                       turns_t found[MOST_ARCS]) {
    const kr_decoupled *arm = s->arm;
    const double ca4 = arm->cosine[3], sa4 = arm->sine[3], ca5 = arm->cosine[4], sa5 = arm->sine[4];
    const double sine = sqrt(n[2] * n[2] + n[6] * n[6]);
    kr_pitch arcs[MOST_ARCS];
    int count = 1;
    if (sine > s->aligned) {
        const double c5 = cos(q5), s5 = sin(q5), g = s5 * sa5, f = -ca4 * c5 * sa5 - sa4 * ca5;
        const double q4 = kr_atan2(n[6] * g - n[2] * f, n[2] * g + n[6] * f);
        if (sine > NEAR_WRIST) {
            const double h = sa4 * s5, k = sa4 * c5 * ca5 + ca4 * sa5;
            found[0].branch = found[0].flags = 0, found[0].q4 = q4, found[0].q5 = q5;
            found[0].q6 = kr_atan2(n[8] * k - n[9] * h, n[8] * h + n[9] * k);
            return 1;
        }
        if (palm) hand_pitches(s, q4, palm, arcs);
        const double moved = palm ? fabs(arcs[0].pitch - q4) * sine : 0.0;
        arcs[0].side = 0;
        if (!(0.0 < moved && moved <= s->aligned))  /* else the wrist is almost free */
            arcs[0].pitch = q4, arcs[0].flags = 0;
    } else {
        set_free(s->doubt, palm ? 5 : 3);
        if (palm) {
            /* the last joint falls as the pitch grows, or grows */
            const double sign = copysign(1.0, n[10]);
            count = hand_pitches(s, kr_wrapped(sign * (last_turn(arm, n, 0.0, q5) - palm->last)), palm, arcs);
        } else
            arcs[0].side = 0, arcs[0].flags = KR_WRIST, arcs[0].pitch = first;
    }
    for (int k = 0; k < count; k++) {
        found[k].branch = arcs[k].side, found[k].flags = arcs[k].flags;
        found[k].q4 = arcs[k].pitch, found[k].q5 = q5, found[k].q6 = last_turn(arm, n, arcs[k].pitch, q5);
    }
    return count;
}

/* Both ways to make a rotation n of three turns, Rz(first) Rx(alpha4) Rz(q5) Rx(alpha5) Rz(last); arguments as in
 * `outer_turns`, and `gain` as in `folded`. Returns how many there are. */
static int wrists(const search_t *s, const double n[12], double gain, double first, const palm_t *palm,
                  turns_t found[MOST_TURNS]) {
    const kr_decoupled *arm = s->arm;
    const double sa4 = arm->sine[3], sa5 = arm->sine[4], sine = sqrt(n[2] * n[2] + n[6] * n[6]);
    double middle;
    int merged, count = 0;
    nearly_aligned(s->doubt, sine, gain);
    if (arm->right_angles) {
        middle = kr_atan2(sine, -n[10] * sa4 * sa5), merged = !(sine > s->aligned);
        if (sine > NEAR_WRIST && !merged) {
            found[0].q4 = kr_atan2(n[6] * sa5, n[2] * sa5), found[0].q6 = kr_atan2(-n[9] * sa4, n[8] * sa4);
            found[1].q4 = found[0].q4 + KR_PI, found[1].q6 = found[0].q6 + KR_PI;
            found[0].q5 = middle, found[1].q5 = -middle;
            found[0].branch = 0, found[1].branch = 2, found[0].flags = found[1].flags = 0;
            return 2;
        }
    } else {
        const double cosine = (arm->cosine[3] * arm->cosine[4] - n[10]) / (sa4 * sa5);
        folded(s->doubt, 1.0 - cosine * cosine, fabs(sa4 * sa5), gain);
        if (!(fabs(sa4 * sa5) * (fabs(cosine) - 1.0) <= fmax(s->aligned, CLOSE))) return 0;
        middle = acos(fmin(1.0, fmax(-1.0, cosine)));
        merged = sin(middle) < KR_MERGED;
        if (merged) middle = cosine > 0.0 ? 0.0 : KR_PI;  /* between the two */
    }
    for (int side = 0; side < (merged ? 1 : 2); side++) {
        const int arcs = outer_turns(s, n, side ? -middle : middle, first, palm, found + count);
        for (int k = 0; k < arcs; k++, count++) {
            found[count].branch ^= 2 * side;
            if (merged) found[count].flags |= KR_WRIST;
        }
    }
    return count;
}

/* Add both elbows of an arm whose hand has the pitch q234; returns how many there are. */
static int add_arms(search_t *s, int branch, int flags, double q1, const turns_t *turns, const palm_t *palm, double gain) {
    double sine, cosine;
    elbow_t found[2];
    kr_sincos(turns->q4 + palm->angle, &sine, &cosine);
    const int count = elbows(s, palm->u - palm->hand * cosine, palm->v - palm->hand * sine, gain, found);
    for (int k = 0; k < count; k++)
        add(s, branch + found[k].branch, flags | found[k].flags, q1, found[k].q2, found[k].q3,
            turns->q4 - found[k].q2 - found[k].q3, turns->q5, turns->q6);
    return count;
}

/* Postures of an arm with axes 2, 3 and 4 parallel, and 5 and 6 that meet. */
static void three_parallel(search_t *s) {
    const kr_decoupled *arm = s->arm;
    shoulder_t sides[2];
    const int count = shoulders(s, sides);
    for (int k = 0; k < count; k++) {
        const shoulder_t *side = sides + k;
        const palm_t palm = {side->u, side->v, arm->hand, arm->hand_angle, s->start[5]};
        const double turned = 1.0 + 1.0 / fmax(fabs(side->u + arm->a[0]), s->tol);
        double n[12];
        turns_t turns[MOST_TURNS];
        behind(s->pose, side->c1, side->s1, arm->cosine[0], arm->sine[0], n);
        const int wrist_count = wrists(s, n, turned, 0.0, &palm, turns);
        int reached = !side->flags;
        for (int i = 0; i < wrist_count; i++) {
            double gain = 1.0;
            if (s->doubt) {
                const double sine = fmax(fabs(arm->sine[3] * arm->sine[4] * sin(turns[i].q5)), s->tol);
                gain = side->gain + turned * arm->hand / sine;
            }
            if (add_arms(s, side->branch + turns[i].branch, side->flags | turns[i].flags, side->q1, turns + i, &palm, gain))
                reached = 1;
        }
        if (!reached)  /* other values of a free joint may reach */
            add(s, side->branch, side->flags, side->q1, s->start[1], s->start[2], s->start[3], s->start[4], s->start[5]);
    }
}

/* Coefficients of 1, c, s, c c, c s, s s in the square of a + b c + d s. */
static void square_of(const double line[3], double k[6]) {
    const double a = line[0], b = line[1], d = line[2];
    k[0] = a * a, k[1] = 2.0 * a * b, k[2] = 2.0 * a * d, k[3] = b * b, k[4] = 2.0 * b * d, k[5] = d * d;
}

/* Postures of an arm with axes 2, 3 and 4 parallel, and 5 and 6 that do not meet.
 *
 * The height of P above the plane gives the sine of q5, and the direction of axis 6 its cosine; both are linear in the
 * cosine and sine of q1. */
static void three_parallel_by_roots(search_t *s) {
    const kr_decoupled *arm = s->arm;
    const double *P = s->pose, x = P[3], y = P[7], z = P[11], ca1 = arm->cosine[0], sa1 = arm->sine[0];
    const double ca4 = arm->cosine[3], sa4 = arm->sine[3], ca5 = arm->cosine[4], sa5 = arm->sine[4], a5 = arm->a[4];
    const double by_s5 = sa4 * a5, by_c5 = -sa4 * sa5;
    const double sine[3] = {(ca1 * z - arm->height) / by_s5, -sa1 * y / by_s5, sa1 * x / by_s5};
    const double cosine[3] = {(ca1 * P[10] - ca4 * ca5) / by_c5, -sa1 * P[6] / by_c5, sa1 * P[2] / by_c5};
    double equation[6], other[6];
    kr_root roots[KR_MAX_ROOTS];
    square_of(sine, equation), square_of(cosine, other);
    for (int k = 0; k < 6; k++) equation[k] += other[k];
    equation[0] -= 1.0;
    const double moved = 2.0 / fabs(by_s5) + 2.0 / fabs(by_c5);
    const int count = kr_circle_roots(equation, s->start[0], s->tol / arm->size, moved, s->doubt, roots);
    if (count == 1 && roots[0].merged && roots[0].angle == s->start[0]) set_free(s->doubt, 0);
    const double slope = 2.0 / fmin(fabs(by_s5), fabs(by_c5));  /* of q1, if the nearest other root is 1 rad away */
    for (int root = 0; root < count; root++) {
        const double q1 = roots[root].angle, c1 = cos(q1), s1 = sin(q1);
        double apart = 1.0, n[12];
        for (int k = 0; k < count; k++)
            if (k != root) apart = fmin(apart, fabs(kr_wrapped(q1 - roots[k].angle)));
        const double turned = 1.0 + slope / fmax(apart, APART);
        const double q5 = atan2(sine[0] + sine[1] * c1 + sine[2] * s1, cosine[0] + cosine[1] * c1 + cosine[2] * s1);
        behind(P, c1, s1, ca1, sa1, n);
        const double ahead = arm->a[3] + a5 * cos(q5), aside = ca4 * a5 * sin(q5) - sa4 * arm->d[4];
        const palm_t palm = {x * c1 + y * s1 - arm->a[0], ca1 * (y * c1 - x * s1) + sa1 * z, hypot(ahead, aside),
                             atan2(aside, ahead), s->start[5]};
        const double tilt = sqrt(n[2] * n[2] + n[6] * n[6]);
        nearly_aligned(s->doubt, tilt, turned);
        const double through = 1.0 + turned * (hypot(x, y) + palm.hand / fmax(tilt, s->tol));
        turns_t arcs[MOST_ARCS];
        const int arc_count = outer_turns(s, n, q5, 0.0, &palm, arcs);
        for (int k = 0; k < arc_count; k++)
            add_arms(s, (2 * root) ^ arcs[k].branch, arcs[k].flags | (roots[root].merged ? KR_SHOULDER : 0), q1, arcs + k,
                     &palm, through);
    }
}

static int arm_by_shoulder(const search_t *s, position_t found[MOST_POSITIONS]) {
    shoulder_t sides[2];
    elbow_t bends[2];
    int total = 0;
    const int count = shoulders(s, sides);
    for (int k = 0; k < count; k++) {
        const int elbow_count = elbows(s, sides[k].u, sides[k].v, sides[k].gain, bends);
        for (int i = 0; i < elbow_count; i++, total++) {
            found[total].branch = sides[k].branch + bends[i].branch, found[total].flags = sides[k].flags | bends[i].flags;
            found[total].q1 = sides[k].q1, found[total].q2 = bends[i].q2, found[total].q3 = bends[i].q3;
        }
    }
    return total;
}

/* The other coordinate of points on a circle of which one is given [m], with flags; returns how many there are. */
static int chord(const search_t *s, double given, double radius, double gain, double rest[2], int *flags) {
    const double square = radius * radius - given * given, share = given / radius;
    folded(s->doubt, radius > 0.0 ? 1.0 - share * share : 0.0, radius, gain);
    *flags = 0;
    if (square > KR_MERGED * radius * (KR_MERGED * radius)) {
        rest[0] = sqrt(square), rest[1] = -rest[0];
        return 2;
    }
    rest[0] = 0.0, *flags = KR_SHOULDER;
    return fabs(given) <= radius + fmax(s->tol, CLOSE);
}

/* First three angles of any three axes that bring a point to a place.
 *
 * The place's distance from the origin and its height along axis 1 do not depend on q1. With (x, y) where joint 2 turns
 * the point that joint 3 has brought into its plane, each is linear in one of x and y. */
static int arm_by_roots(const search_t *s, position_t found[MOST_POSITIONS]) {
    const kr_decoupled *arm = s->arm;
    const double px = s->pose[3], py = s->pose[7], pz = s->pose[11];
    const double a1 = arm->a[0], ca1 = arm->cosine[0], sa1 = arm->sine[0];
    const double *square = arm->square_of_point, *height = arm->height_of_point;
    /* 2 a1 x = far, sa1 y = high, x^2 + y^2 = square - height^2 */
    const double far[3] = {px * px + py * py + pz * pz - a1 * a1 - square[0], -square[1], -square[2]};
    const double high[3] = {pz - ca1 * height[0], -ca1 * height[1], -ca1 * height[2]};
    const int meet = fabs(a1) < KR_ZERO, parallel = sa1 == 0.0;  /* axes 1 and 2 */
    const double distance = sqrt(px * px + py * py + pz * pz);
    double equation[6] = {0.0}, moved;
    kr_root roots[KR_MAX_ROOTS];
    if (meet || parallel) {
        memcpy(equation, meet ? far : high, 3 * sizeof *equation);
        moved = meet ? 2.0 * distance : 1.0;
    } else {
        const double by_far = sa1 * sa1, by_high = 4.0 * a1 * a1;
        double f[6], h[6], z[6];
        square_of(far, f), square_of(high, h), square_of(height, z);
        for (int k = 0; k < 6; k++)
            equation[k] = by_far * f[k] + by_high * (h[k] + by_far * z[k]) - by_far * by_high * (k < 3 ? square[k] : 0.0);
        moved = 8.0 * fabs(a1 * sa1) * (distance + fabs(a1)) * (fabs(sa1) * distance + fabs(a1));
    }
    int total = 0;
    const int count = kr_circle_roots(equation, s->start[2], s->tol / arm->size, moved, s->doubt, roots);
    for (int root = 0; root < count; root++) {
        const double q3 = roots[root].angle, c3 = cos(q3), s3 = sin(q3);
        double gain = 1.0, point[3], ends[2];
        int flag = 0, end_count = 1;
        if (meet || parallel) {  /* by how much the chord's end moves, as joint 3 turns */
            gain += arm->fore * moved / fmax(fabs(equation[2] * c3 - equation[1] * s3), KR_ZERO);
            gain /= meet ? fabs(sa1) : fmin(fabs(a1), 1.0);
        }
        centre(arm, c3, s3, point);
        const double r2 = hypot(point[0], point[1]);
        const double along = meet ? 0.0 : 0.5 * (far[0] + far[1] * c3 + far[2] * s3) / a1;
        const double aside = parallel ? 0.0 : (high[0] + high[1] * c3 + high[2] * s3) / sa1;
        if (meet || parallel) end_count = chord(s, meet ? aside : along, r2, gain, ends, &flag);
        for (int other = 0; other < end_count; other++, total++) {
            const double x = meet ? ends[other] : along, y = parallel && !meet ? ends[other] : aside;
            const double q2 = r2 > s->tol ? atan2(y, x) - atan2(point[1], point[0]) : s->start[1];
            const double c2 = cos(q2), s2 = sin(q2);
            const double u = c2 * point[0] - s2 * point[1] + a1;
            const double v = ca1 * (s2 * point[0] + c2 * point[1]) - sa1 * point[2];
            const int on_axis = hypot(u, v) <= s->tol, on_second = r2 <= s->tol;
            if (on_axis) set_free(s->doubt, 0);
            if (on_second) set_free(s->doubt, 1);
            position_t *to = found + total;
            to->branch = meet || parallel ? 4 * root + other : 4 * (root / 2) + root % 2;
            to->flags = flag | (roots[root].merged ? KR_ELBOW : 0) | (on_axis || on_second ? KR_SHOULDER : 0);
            to->q1 = on_axis ? s->start[0] : atan2(py, px) - atan2(v, u), to->q2 = q2, to->q3 = q3;
        }
    }
    return total;
}

/* By how much joints 1 to 3 turn at most if they move the centre of a spherical wrist [rad/m]. */
static double turned_by_moves(const kr_decoupled *arm, double q2, double q3) {
    const double c2 = cos(q2), s2 = sin(q2), sa1 = arm->sine[0];
    double p[3], sides[3][3], square = 0.0;
    centre(arm, cos(q3), sin(q3), p);  /* as seen behind joint 2 */
    const double axis1[3] = {s2 * sa1, c2 * sa1, arm->cosine[0]}, axis3[3] = {0.0, -arm->sine[1], arm->cosine[1]};
    const double from1[3] = {p[0] + arm->a[0] * c2, p[1] - arm->a[0] * s2, p[2]};
    const double from3[3] = {p[0] - arm->a[1], p[1], p[2] - arm->d[1]}, second[3] = {-p[1], p[0], 0.0};
    double first[3], third[3];
    cross(axis1, from1, first), cross(axis3, from3, third);
    cross(second, third, sides[0]), cross(third, first, sides[1]), cross(first, second, sides[2]);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) square += sides[i][k] * sides[i][k];
    const double volume = first[0] * sides[0][0] + first[1] * sides[0][1] + first[2] * sides[0][2];
    return sqrt(square) / fmax(fabs(volume), KR_ZERO);
}

/* Postures of an arm with a spherical wrist. */
static void spherical(search_t *s) {
    const kr_decoupled *arm = s->arm;
    position_t positions[MOST_POSITIONS];
    const int count = arm->by_shoulder ? arm_by_shoulder(s, positions) : arm_by_roots(s, positions);
    double shoulder[12] = {0.0}, n[12];
    turns_t turns[MOST_TURNS];
    for (int k = 0; k < count; k++) {
        const position_t *p = positions + k;
        const double gain = s->doubt ? 1.0 + turned_by_moves(arm, p->q2, p->q3) : 1.0;
        if (k == 0 || p->q1 != p[-1].q1) behind_turn(s->pose, p->q1, arm->cosine[0], arm->sine[0], shoulder);
        if (arm->sine[1] == 0.0)
            behind_turn(shoulder, p->q2 + p->q3, arm->cosine[2], arm->sine[2], n);
        else {
            double upper[12];
            behind_turn(shoulder, p->q2, arm->cosine[1], arm->sine[1], upper);
            behind_turn(upper, p->q3, arm->cosine[2], arm->sine[2], n);
        }
        const int wrist_count = wrists(s, n, gain, s->start[3], NULL, turns);
        for (int i = 0; i < wrist_count; i++)
            add(s, p->branch + turns[i].branch, p->flags | turns[i].flags, p->q1, p->q2, p->q3, turns[i].q4, turns[i].q5,
                turns[i].q6);
        if (p->flags && !wrist_count)  /* other values of a free joint may reach */
            add(s, p->branch, p->flags, p->q1, p->q2, p->q3, s->start[3], s->start[4], s->start[5]);
    }
}

static void seen_from_first(const kr_decoupled *arm, const double T[12], double pose[12]) {
    double M[12];
    kr_times(arm->before, T, M);
    kr_times(M, arm->after, pose);
}

int kr_decoupled_solved(const kr_decoupled *arm, const double T[12], double tol, double aligned, const double seed[6],
                        kr_doubt *doubt, double *rows) {
    search_t s;
    s.arm = arm, s.tol = tol, s.aligned = aligned, s.doubt = doubt, s.rows = rows, s.count = 0;
    seen_from_first(arm, T, s.pose);
    for (int j = 0; j < JOINTS; j++) s.start[j] = arm->sign[j] * seed[j] + arm->offset[j];
    (arm->spherical ? spherical : arm->by_shoulder ? three_parallel : three_parallel_by_roots)(&s);
    return s.count;
}

int kr_decoupled_hands(const kr_decoupled *arm, const double T[12], double tol, double q1[20]) {
    const double ca1 = arm->cosine[0], sa1 = arm->sine[0];
    double pose[12];
    int count = 0;
    if (arm->spherical) return 0;
    seen_from_first(arm, T, pose);
    const double axis6[3] = {pose[2], pose[6], pose[10]}, nearest = atan2(sa1 * axis6[0], -sa1 * axis6[1]);
    double most = 0.0, off[3];
    const double same[3] = {sin(nearest) * sa1, -cos(nearest) * sa1, copysign(ca1, axis6[2])};
    cross(axis6, same, off);
    for (int k = 0; k < 3; k++) most = fmax(most, fabs(off[k]));
    for (int k = 0; k < 2 && most <= tol; k++) q1[count++] = arm->sign[0] * (nearest + k * KR_PI - arm->offset[0]);
    for (int k = 0; k < 2; k++) {
        const double angle = nearest + k * KR_PI, axis2[3] = {sin(angle) * sa1, -cos(angle) * sa1, ca1};
        cross(axis6, axis2, off);
        const double tilt = sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2]);
        for (int i = 0; i < HAND_TURNS && tol < tilt && tilt < NEARLY_PARALLEL; i++) {
            const double turn = tan(WIDEST_TURN * (2.0 * i / (HAND_TURNS - 1) - 1.0));
            q1[count++] = arm->sign[0] * (angle + tilt * turn - arm->offset[0]);
        }
    }
    return count;
}
