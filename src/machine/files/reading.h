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

/* Reads the terms of one part. The file does not have the key if the line of `value` is 0. */
lg_status lg_machine_read_terms(lg_machine_reading *r, lg_machine_part part, const lg_key_value *value);

/* Reads the keys `system`, `form` and `parameters`. A key with line 0 is not in the file. */
lg_status lg_machine_read_system(lg_machine_reading *r, const lg_key_value *system, const lg_key_value *form,
                                 const lg_key_value *parameters);

/* Refuses a machine of `measured: velocities-only` that depends on positions (speeds.c). */
lg_status lg_machine_refuse_positions(lg_machine_reading *r);

#endif
