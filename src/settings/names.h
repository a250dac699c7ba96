/* Names of values that are used by several tables of fields. */
#ifndef LG_NAMES_H
#define LG_NAMES_H

#include <stdint.h>

/* Name of an enumeration's value, or NULL if `value` is beyond the last one. */
const char *lg_name_activation(uint32_t value);
const char *lg_name_scheme(uint32_t value);
const char *lg_name_schedule(uint32_t value);
const char *lg_name_net(uint32_t value);
const char *lg_name_truth(uint32_t value);  /* false, true */
const char *lg_name_values(uint32_t value); /* discrete, continuous (curves) */
const char *lg_name_yes(uint32_t value);    /* no, yes */

/* The scheme at this position; its name is lg_name_scheme(value). */
const void *lg_scheme_number(uint32_t value);

#endif
