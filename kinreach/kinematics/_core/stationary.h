/* Postures with the tip at a point, at which its orientation error is stationary. */
#ifndef KR_STATIONARY_H
#define KR_STATIONARY_H

#include "core.h"

/* The tip at p, and the trace of W^T R as large as it becomes: the cosine of the angle to a direction, or twice that to an
 * orientation plus 1. */
typedef struct {
    const kr_arm *arm;
    double W[9], p[3];
} kr_stationary_goal;

enum { KR_MINIMUM, KR_SADDLE, KR_MAXIMUM, KR_NO_KIND };

/* A posture; which joints are held, and which of them at a limit, as bits; by how much the trace grows with each; and the kind
 * of its error. */
typedef struct {
    double q[KR_FIVE_JOINTS], slope[KR_FIVE_JOINTS], trace;
    int held, face, kind;
} kr_stationary_posture;

/* One step of Newton's method to a stationary posture with some joints held; returns 0 where there is none. */
int kr_stationary_step(const kr_stationary_goal *goal, int held, const double *q, double step[KR_FIVE_JOINTS]);

/* Newton's method from a posture in place; returns 0 if it does not converge, or to none that is least with joints at a limit. */
int kr_make_stationary(const kr_stationary_goal *goal, kr_stationary_posture *posture);

#endif
