/* Shared by the readers of a machine's file: machine.c (coordinates and columns), grey.c (the named system)
 * and terms.c (mass, potential, ...). */
#ifndef LG_MACHINE_READING_H
#define LG_MACHINE_READING_H

#include "settings/files/yaml.h"
#include "liegrad/machine.h"

struct yaml_node_s;

typedef struct lg_machine_reading {
    lg_yaml *yaml;
    lg_machine_file *out;
    lg_error *error;
    /* Line of each term of the machine in the file; 0: the file does not name the term. */
    uint32_t lines[LG_MACHINE_TERMS];
} lg_machine_reading;

/* Calls visit(r, line, text, user) for the text of a scalar, or for each text of a list. `what` names the key
 * in messages. */
typedef lg_status (*lg_text_visit)(lg_machine_reading *r, uint32_t line, const char *text, void *user);
lg_status lg_machine_texts(lg_machine_reading *r, const void *node, const char *what, lg_text_visit visit,
                           void *user);

/* Numbers that are unknown one by one (entries.c). lg_machine_is_entry: whether the node is the word
 * `unknown` or {start: ..., within: ..., sigma: ...}; lg_machine_read_entry reads it, *start is NaN where
 * it is not given, and allows the key `order` if `ordered`. lg_machine_has_entries looks into lists, too.
 * lg_machine_read_entries reads the values of a term, some of which are unknown. */
bool lg_machine_is_entry(const struct yaml_node_s *node);
bool lg_machine_has_entries(const lg_machine_reading *r, const struct yaml_node_s *node);
lg_status lg_machine_read_entry(lg_machine_reading *r, const char *what, bool ordered,
                                const struct yaml_node_s *node, double *start, lg_machine_entry *out);
lg_status lg_machine_read_entries(lg_machine_reading *r, const lg_field *key, const struct yaml_node_s *node,
                                  lg_machine_term *term);

/* Reads the terms of one part. The file does not have the key if the line of `value` is 0. */
lg_status lg_machine_read_terms(lg_machine_reading *r, lg_machine_part part, const lg_key_value *value);

/* Reads the keys `system`, `form` and `parameters`. A key with line 0 is not in the file. */
lg_status lg_machine_read_system(lg_machine_reading *r, const lg_key_value *system, const lg_key_value *form,
                                 const lg_key_value *parameters);

/* Read how inputs act (actuators.c): `hold` and `delay`, then `lag` and `curve`. A key with line 0 is not in
 * the file. */
lg_status lg_machine_read_timing(lg_machine_reading *r, const lg_key_value *hold, const lg_key_value *delay);
lg_status lg_machine_read_actuators(lg_machine_reading *r, const lg_key_value *lag,
                                    const lg_key_value *curve);
/* Refuses a machine of `measured: velocities-only` that depends on positions (speeds.c). */
lg_status lg_machine_refuse_positions(lg_machine_reading *r);

#endif
