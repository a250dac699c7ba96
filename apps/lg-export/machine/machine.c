/* Learned machines: golden states like the training data, and the description in NAME.h. */
#include <math.h>
#include <string.h>

#include "lg-export/faces.h"
#include "liegrad/machine.h"

static const lg_machine_model_run *run_of(const export_model *m) {
    return &((const lg_machine_model_file *)m->file->contents)->run;
}

/* ---- golden vectors ---- */

static double draw_in(const lg_machine_range *range, size_t at, lg_rng *rng) {
    const double low = range->low[at], high = range->high[at];
    const bool known = low < high && isfinite(low) && isfinite(high);
    return known ? lg_rng_uniform_in(rng, low, high) : lg_rng_uniform_in(rng, -1.0, 1.0);
}

static double draw_input(export_model *m, size_t k) {
    const lg_machine *machine = &run_of(m)->machine;
    return draw_in(&run_of(m)->range, machine->positions + machine->velocities + k, &m->rng);
}

/* Draws a state whose positions and velocities are within the range of the training data; directions and
 * rotations are anywhere. */
static void draw(export_model *m, double *x, size_t v_at) {
    const lg_machine *machine = &run_of(m)->machine;
    double q[LG_MACHINE_POSITIONS], v[LG_MACHINE_VELOCITIES];
    uint32_t at = 0;
    memset(x, 0, m->dim * sizeof *x);
    export_turn(m, x);
    (void)lg_model_machine_positions(m->file->model, x, q, m->work);
    for (uint32_t i = 0; i < machine->coordinate_count; i++) {
        const lg_coordinate_kind kind = machine->coordinates[i].kind;
        for (uint32_t k = 0; k < lg_coordinate_row_of(kind)->places; k++)
            q[at + k] = draw_in(&run_of(m)->range, at + k, &m->rng);
        at += lg_coordinate_positions(kind);
    }
    for (uint32_t k = 0; k < machine->velocities; k++) v[k] = draw_in(&run_of(m)->range, at + k, &m->rng);
    (void)lg_model_machine_state(m->file->model, q, v, x, m->work);
    for (uint32_t k = 0; k < machine->lags; k++)
        x[m->dim - machine->lags + k] = draw_input(m, machine->lagged[k]);
}

/* ---- description in NAME.h ---- */

static const char words_of_field[] = "an element of the algebra: rates of places, omega and moment of each "
                                     "direction, R Omega of each rotation, "
                                     "rates of momenta, of bristles and of lagged inputs";

static void tell(export_model *m) {
    export_source *source = m->source;
    text *about = &source->about;
    lg_text_add(about, "Learned machine with inputs and damping; liegrad/machine.h has the equations.\n\n");
    export_tell_numbers(about, "state", m->dim, source->state.data);
    APP_FREE char *words = m->forces > 0 ? app_format("%s as in the log; NULL for zeros", source->input.data)
                                         : app_format("none: NULL");
    export_tell_numbers(about, "input", m->forces, words);
    if (source->delay.length > 0) lg_text_add(about, "delay         %s\n", source->delay.data);
    export_tell_numbers(about, "field", m->algebra, words_of_field);
    export_tell_numbers(about, "positions", m->positions, "in the order of the log, R by rows");
    export_tell_numbers(about, "velocities", m->velocities, "in the order of the log");
    export_units(source, "those of the log; momenta are mass times velocity");
    lg_text_add(about,
                "manifold      A state off it is not projected; steps keep the distance but for rounding.\n");
    export_tell_motion(m);
    lg_text_add(about, "%s", source->range.data);
}

const export_kind export_kind_machine = {.recipe = &lg_recipe_machine_model,
                                         .words = export_machine_words,
                                         .draw = draw,
                                         .draw_input = draw_input,
                                         .tell = tell};
