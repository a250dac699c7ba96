/* Coefficients of the series of dexpinv, used by the plain and by the taped interpreter. */
#ifndef LG_SERIES_H
#define LG_SERIES_H

#include "liegrad/integrators.h"

/* Entry k is B_k / k!, the coefficient of ad_a^k; B_k are the Bernoulli numbers. */
extern const double lg_dexpinv_series[LG_DEXPINV_MAX + 1];

#endif
