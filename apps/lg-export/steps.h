/* One step of a scheme as C: what a scheme costs, and its tables. */
#ifndef LG_EXPORT_STEPS_H
#define LG_EXPORT_STEPS_H

#include "lg-export/export.h"

/* What NAME_step is made of: the scheme without what only its embedded solution needs. */
typedef struct step_plan {
    const lg_scheme *scheme;
    int stages;      /* evaluations of the field, of splitting schemes: steps in turn */
    int evaluations; /* of the network's gradient */
    size_t work;     /* reals, behind those of NAME_field */
} step_plan;

/* Of source->options->scheme. Schemes that have no explicit step on the model's space: a sentence and
 * APP_EXIT_USAGE. */
int step_choose(const app *self, const export_source *source, const lg_hamiltonian *model, step_plan *out);
/* Constants, tables and fragments of NAME_step, whose memory begins at real `begin` of work; where it ends.
 */
size_t step_code(export_source *source, const step_plan *step, bool chain, size_t begin);
const char *step_scheme_name(const lg_scheme *scheme);

#endif
