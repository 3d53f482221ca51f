/* Three revolute joints that bring a point to a point. */
#ifndef KR_THREE_JOINTS_H
#define KR_THREE_JOINTS_H

enum { KR_MAX_TRIPLES = 16 };

/* Angles at which the tip of the chain T = B0 Rz(qa) B1 Rz(qb) B2 Rz(qc) B3 is at p, into q (16, 3); returns how many. Those
 * at which two merge are there once; where an angle is free it is 0. They are zeros of `function` of qc, as in `circle.h`,
 * which is smooth in B and p, and 0 where qc does not determine the others; with a null q nothing else is computed. */
int kr_three_joints(const double B[48], const double p[3], double function[6], double q[3 * KR_MAX_TRIPLES]);

#endif
