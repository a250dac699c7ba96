/* Names of values that several tables of fields share. */
#ifndef LG_NAMES_H
#define LG_NAMES_H

#include <stdint.h>

/* Names of enumerations by value; NULL beyond the last. */
const char *lg_name_activation(uint32_t value);
const char *lg_name_scheme(uint32_t value);
const char *lg_name_schedule(uint32_t value);
const char *lg_name_net(uint32_t value);
const char *lg_name_truth(uint32_t value);  /* false, true */
const char *lg_name_values(uint32_t value); /* of curves: discrete, continuous */
const char *lg_name_yes(uint32_t value);    /* no, yes */

/* The scheme that has this name. */
const void *lg_scheme_number(uint32_t value);

#endif
