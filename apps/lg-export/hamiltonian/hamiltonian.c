/* Learned Hamiltonians: the condition of the mass matrix, and the description in NAME.h. */
#include <math.h>
#include <string.h>

#include "lg-export/faces.h"
#include "liegrad/hamiltonian.h"
#include "liegrad/minimise.h"

/* ---- the mass matrix ---- */

/* Sets the condition of the source from the mass matrix m without the model's scales: with W = m^-1, the
 * largest m_ii W_ii >= 1 multiplies the rounding errors of systems solved with m. It says how nearly the rows
 * of m are linearly dependent, whatever their scale. Up to 20 it needs no factor: the tolerance, 20 eps
 * depth, has room for that. Returns false if W has numbers that the exported type cannot hold. */
static bool find_condition(export_source *source, const lg_hamiltonian *model, const double *theta) {
    const size_t k = model->n;
    APP_FREE double *m = app_alloc(k * k, sizeof *m), *W = app_alloc(k * k, sizeof *W),
                    *diagonal = app_alloc(k, sizeof *diagonal);
    lg_hamiltonian inner = *model;
    bool fits = true;
    inner.scales = (lg_hamiltonian_scales){1.0, {1.0, 1.0}};
    if (lg_hamiltonian_mass(&inner, theta, m) != LG_OK) return true;
    for (size_t i = 0; i < k; i++) diagonal[i] = m[i * k + i], W[i * k + i] = 1.0;
    if (lg_normal_equations(k, k, 0.0, m, W) != LG_OK) return false;
    for (size_t i = 0; i < k; i++) {
        source->condition = fmax(source->condition, diagonal[i] * W[i * k + i] / 20.0);
        fits = fits && diagonal[i] > 0.0;
        for (size_t j = 0; j < k; j++) fits = fits && isfinite(export_round(source->options, W[i * k + j]));
    }
    return fits;
}

/* ---- description in NAME.h ---- */

/* Describes the state: "q1 p1 q2 p2 ..., each with |q| = 1 and q.p = 0". */
static void tell_state(export_source *source, const lg_hamiltonian *model) {
    const lg_hamiltonian_family *family = model->family;
    /* How many copies are written out, with numbers; 0: the layout is written once, without numbers. */
    const uint32_t groups = !family->numbered || model->n == 1 ? 0 : 2;
    text *words = &source->state;
    for (const char *const *part = family->layout; groups == 0 && *part != NULL; part++)
        lg_text_add(words, "%s%s", part > family->layout ? " " : "", *part);
    for (uint32_t i = 1; i <= groups; i++)
        for (const char *const *part = family->layout; *part != NULL; part++)
            lg_text_add(words, "%s%s%u", i > 1 || part > family->layout ? " " : "", *part, i);
    lg_text_add(words, "%s", groups > 0 && model->n > groups ? " ..." : "");
    if (family->manifold != NULL)
        lg_text_add(words, ", %s%s", groups > 0 ? "each with " : "", family->manifold);
}

static void give_words(const void *contents, export_source *source) {
    const lg_hamiltonian *model = &((const lg_hamiltonian_file *)contents)->run.model;
    const char *meaning = model->family->input_meaning;
    source->step = ((const lg_hamiltonian_file *)contents)->run.dt;
    tell_state(source, model);
    if (lg_hamiltonian_input_dim(model) > 0 && meaning != NULL) lg_text_add(&source->input, "%s", meaning);
}

static void tell_model(export_source *source, const lg_hamiltonian *model) {
    const lg_hamiltonian_family *family = model->family;
    text *about = &source->about;
    const size_t d = lg_hamiltonian_state_dim(model), m = lg_hamiltonian_input_dim(model);
    char input[256];
    lg_text_add(about, "Learned Hamiltonian, family %s, of %u %s%s%s%s.\n\n", family->name, model->n,
                family->copy, model->n == 1 ? "" : "s", family->formula != NULL ? ": H = " : "",
                family->formula != NULL ? family->formula : "");
    export_tell_numbers(about, "state", d, source->state.data);
    (void)snprintf(input, sizeof input, "%s%sNULL for none",
                   family->input_meaning != NULL ? family->input_meaning : "",
                   family->input_meaning != NULL ? "; " : "");
    export_tell_numbers(about, "input", m, m > 0 ? input : "none: NULL");
    export_tell_numbers(about, "field", d,
                        family->field_meaning != NULL ? family->field_meaning : "an element of the algebra");
    export_units(source, "those of the training data");
    lg_text_add(about, "time          as in the dt of the training data\n");
    if (family->manifold != NULL)
        lg_text_add(
            about,
            "manifold      A state off it is not projected: value, gradient and field are those of the\n"
            "              formulas as they stand, and steps keep the distance but for rounding.\n");
}

static void tell(export_model *m) {
    const lg_hamiltonian_file *file = m->file->contents;
    tell_model(m->source, &file->run.model);
    export_tell_motion(m);
}

/* ---- depth, and checks before the code is written ---- */

static size_t depth_of(const void *contents) {
    return (size_t)((const lg_hamiltonian_file *)contents)->run.model.net.layers + 1;
}

static void begin(export_model *m) {
    const lg_hamiltonian_file *file = m->file->contents;
    const lg_hamiltonian *model = &file->run.model;
    char copies[64];
    (void)snprintf(copies, sizeof copies, "copies, each a %s", model->family->copy);
    export_size(m->source, "LINKS", model->n, copies);
    if (!find_condition(m->source, model, file->theta))
        app_stop(m->self, LG_FORMAT,
                 "%s: the mass matrix is not positive definite, or its inverse is not a number of the "
                 "exported type",
                 m->self->arguments[0]);
}

const export_kind export_kind_hamiltonian = {
    .recipe = &lg_recipe_hamiltonian, .words = give_words, .begin = begin, .depth = depth_of, .tell = tell};
