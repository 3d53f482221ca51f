/* Arms whose axes 2, 3 and 4 are parallel, with or without a joint 5. */
#ifndef KR_PITCHED_H
#define KR_PITCHED_H

#include "stationary.h"

/* Fill in what `five` needs of such an arm; `pitched` stays 0 for another. */
void kr_pitched_prepare(const kr_arm *arm, kr_five_axis *five);

/* Called with a posture that is next to a stationary one, and the joints that are held there, as bits. */
typedef void kr_start(void *context, int held, const double *q);

/* Find such postures. Joints that do not matter are `fixed` at their angles in q; with `limits` those at limits count, too. */
void kr_pitched_starts(const kr_five_axis *five, const kr_stationary_goal *goal, int fixed, int limits, const double *q,
                       kr_start *start, void *context);

#endif
