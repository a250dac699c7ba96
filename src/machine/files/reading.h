/* Shared by machine.c (coordinates and columns), grey.c (the known system)
 * and terms.c (mass, potential, ...). */
#ifndef LG_MACHINE_READING_H
#define LG_MACHINE_READING_H

#include "settings/files/yaml.h"
#include "liegrad/logs.h"

struct yaml_node_s;

typedef struct lg_machine_reading {
    lg_yaml *yaml;
    lg_machine_file *out;
    lg_error *error;
    uint32_t lines[LG_MACHINE_TERMS]; /* of the machine's terms; 0: the file does not name them */
} lg_machine_reading;

/* visit(r, node, text, user) for the text of a scalar, or for each of a list. `what` names the key. */
typedef lg_status (*lg_text_visit)(lg_machine_reading *r, uint32_t line, const char *text, void *user);
lg_status lg_machine_texts(lg_machine_reading *r, const void *node, const char *what, lg_text_visit visit,
                           void *user);

/* The terms of one part; `value` is the key's, absent when its line is 0. */
lg_status lg_machine_read_terms(lg_machine_reading *r, lg_machine_part part, const lg_key_value *value);

/* `system`, `form` and `parameters`; each absent when its line is 0. */
lg_status lg_machine_read_system(lg_machine_reading *r, const lg_key_value *system, const lg_key_value *form,
                                 const lg_key_value *parameters);

#endif
