/* The series of dexpinv, for both interpreters. */
#ifndef LG_SERIES_H
#define LG_SERIES_H

#include "liegrad/integrators.h"

/* B_k / k!, the coefficient of ad_a^k */
extern const double lg_dexpinv_series[LG_DEXPINV_MAX + 1];

#endif
