/* Pitches of a hand that two links carry in a plane. */
#ifndef KR_PITCHES_H
#define KR_PITCHES_H

/* What a posture has that is singular, as bits of its flags: which part is at its singularity, and whether a free joint was
 * moved away from its wanted value. */
enum { KR_SHOULDER = 1, KR_WRIST = 2, KR_ELBOW = 4, KR_MOVED = 8 };

/* A pitch at which the two links reach the hand [rad]; side is 2 for the second of two arcs. */
typedef struct {
    int side, flags;
    double pitch;
} kr_pitch;

/* Pitches nearest to a wanted one at which two links reach the root of a hand, of each arc of such pitches, the nearest arc
 * first. The hand, of some length and with some angle at pitch 0, points at (u, v) from the links' root; the links reach
 * from `folded` to `stretched` [m]. Where nothing is in reach it is the end that comes nearest, and the elbow decides.
 * Returns how many. */
int kr_pitches(double wanted, double u, double v, double hand, double hand_angle, double stretched, double folded,
               kr_pitch arcs[2]);

#endif
