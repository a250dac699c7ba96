/* Names that the files of this folder share: enumerations, systems, layouts, missing keys. */
#ifndef LG_NAMES_H
#define LG_NAMES_H

#include "liegrad/io.h"

/* Names of enumerations by value; NULL beyond the last. */
const char *lg_name_activation(uint32_t value);
const char *lg_name_scheme(uint32_t value);
const char *lg_name_family(uint32_t value);
const char *lg_name_integral(uint32_t value); /* first integrals */
const char *lg_name_potential(uint32_t value);
const char *lg_name_symmetry(uint32_t value);
const char *lg_name_dtype(uint32_t value);
const char *lg_name_penalty_form(uint32_t value);
const char *lg_name_surrogate_penalty(uint32_t value);
const char *lg_name_distance(uint32_t value);
const char *lg_name_start(uint32_t value);
const char *lg_name_units(uint32_t value);
const char *lg_name_machine_start(uint32_t value);
const char *lg_name_noise(uint32_t value);
const char *lg_name_schedule(uint32_t value);
const char *lg_name_surrogate_loss(uint32_t value);
const char *lg_name_surrogate(uint32_t value);
const char *lg_name_net(uint32_t value);
const char *lg_name_split(uint32_t value);
const char *lg_name_detector_loss(uint32_t value);
const char *lg_name_pooling(uint32_t value);
const char *lg_name_values(uint32_t value); /* of curves: 0 discrete, 1 continuous */
const char *lg_name_truth(uint32_t value);  /* false, true */
const char *lg_name_yes(uint32_t value);    /* no, yes */

/* The rows that have these names. */
const void *lg_scheme_number(uint32_t value);
const void *lg_family_number(uint32_t value);

/* The family that learns the system of this name, and its n, 0 for any; NULL: the system is unknown, is not
 * learned or has no default parameters. */
const lg_hamiltonian_family *lg_family_of(const char *system, size_t *n);
/* The form of a learned system: "hamiltonian", or NULL where there is one form only. */
const char *lg_learned_form(const char *system);

/* At least the parameters of any system. */
enum { LG_MOST_PARAMETERS = 16 };

#define LG_LAYOUT_TEXT (12 * LG_HAMILTONIAN_MAX_COPIES)
/* Layout of the family's states: "q1 p1 q2 p2 ..." or "q p". */
void lg_layout_text(const lg_hamiltonian_family *family, uint32_t n, char text[LG_LAYOUT_TEXT]);

/* LG_NOT_FOUND of a key becomes LG_FORMAT, in the result and in `error` (may be NULL). */
lg_status lg_missing_is_format(lg_status status, lg_error *error);

/* Adds them as little-endian doubles, or numbers of four bytes. */
void lg_sha256_add_doubles(lg_sha256 *state, const double *values, size_t count);
void lg_sha256_add_floats(lg_sha256 *state, const float *values, size_t count);
void lg_sha256_add_u32(lg_sha256 *state, const uint32_t *values, size_t count);

#endif
