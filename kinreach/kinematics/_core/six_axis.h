#ifndef KR_SIX_AXIS_H
#define KR_SIX_AXIS_H

#include "core.h"

/* Every posture of a pose, given by its three upper rows, into rows (8, 8) by branch index; returns how many. They miss the
 * pose by less than 1e-9 m and rad on the arm as it is given, unless none does that: then by up to `tol`. */
int kr_decoupled_postures(const kr_decoupled *arm, const double T[12], const double seed[6], double tol, double *rows);

#endif
