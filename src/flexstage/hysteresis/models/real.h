/* Numbers of the model: double precision, or single where FS_SINGLE is defined.
 *
 * Keep the order of operations: compile without contraction of products and sums
 * (-ffp-contract=off) and without fast mathematics where results must equal those of flexstage.
 */
#ifndef FS_REAL_H
#define FS_REAL_H

#include <math.h>

#ifdef FS_SINGLE
typedef float fs_real;
#define FS_R(x) x##f
#define FS_EXP expf
#define FS_EXPM1 expm1f
#define FS_LOG logf
#define FS_LOG1P log1pf
#define FS_SQRT sqrtf
#define FS_POW powf
#define FS_SIN sinf
#define FS_COS cosf
#define FS_ABS fabsf
#define FS_CEIL ceilf
#define FS_RINT rintf
#else
typedef double fs_real;
#define FS_R(x) x
#define FS_EXP exp
#define FS_EXPM1 expm1
#define FS_LOG log
#define FS_LOG1P log1p
#define FS_SQRT sqrt
#define FS_POW pow
#define FS_SIN sin
#define FS_COS cos
#define FS_ABS fabs
#define FS_CEIL ceil
#define FS_RINT rint
#endif

#endif
