#ifndef KR_DECOUPLED_H
#define KR_DECOUPLED_H

#include "circle.h"

/* Room for the rows of one call. */
enum { KR_MAX_ROWS = 64 };

/* Every posture of a pose, given by its three upper rows, into rows (64, 8): branch index, flags and angles in [-pi, pi];
 * one with flags may miss the pose. Returns how many.
 *
 * `tol` is how far one part of the geometry may be missed by a posture in which something is clamped [m, rad]; `aligned`
 * the sine between the outer axes of a wrist below which these are parallel; free joints keep the values of `seed`, as far
 * as they can. `doubt` may be null. */
int kr_decoupled_solved(const kr_decoupled *arm, const double T[12], double tol, double aligned, const double seed[6],
                        kr_doubt *doubt, double *rows);

/* Angles of a free joint 1 that are worth a try for a pose: axis 6 is parallel to three parallel axes there, so that they
 * move together; or it nearly is, and the angles turn the hand evenly: it turns by as much as joint 1 divided by the angle
 * between the axes, so that few of evenly spaced angles of joint 1 would reach. Returns how many. */
int kr_decoupled_hands(const kr_decoupled *arm, const double T[12], double tol, double q1[20]);

#endif
