/* Saving and loading a minimiser: the state is a list of arrays. */
#include <math.h>
#include <string.h>

#include "core/clean.h"
#include "core/stored.h"
#include "nn/minimise_internal.h"

enum { ITEMS = 7 };

/* Lists all arrays. `memory` has the layout of m->memory; `curvature` has the rows of all ranks. */
static void list(const lg_minimiser *m, double *memory, double *curvature, lg_minimise_counts *counts,
                 lg_minimise_numbers *numbers, lg_stored out[ITEMS]) {
    const lg_stored all[ITEMS] = {
        {"minimise/counts", LG_ELEMENT_U64, 1, {sizeof *counts / sizeof(uint64_t)}, .data = counts},
        {"minimise/numbers", LG_ELEMENT_F64, 1, {sizeof *numbers / sizeof(double)}, .data = numbers},
#define ARRAY(name, length, where) {"minimise/" name, LG_ELEMENT_F64, 1, {length}, where, .finite = true}
        ARRAY("x", m->n, memory + (m->x - m->memory)),
        ARRAY("gradient", m->n, memory + (m->g - m->memory)),
        ARRAY("direction", m->n, memory + (m->d - m->memory)),
        ARRAY("point", m->n, memory + (m->point - m->memory)),
        ARRAY("curvature", m->length, curvature),
#undef ARRAY
    };
    memcpy(out, all, sizeof all);
}

/* ---- ranks: m->curvature has this rank's rows, then numbers that all ranks have ---- */

static bool divided(const lg_minimiser *m) {
    return m->options.ranks != NULL && m->row->by_rows;
}

/* Doubles in this rank's rows; 0 for a method without rows. */
static size_t rows_length(const lg_minimiser *m) {
    return m->row->by_rows ? (m->end - m->first) * lg_minimise_stride(m->n) : 0;
}

lg_status lg_minimiser_collect(lg_minimiser *m, lg_error *error) {
    LG_NEEDS(error, m);
    const lg_ranks *ranks = m->options.ranks;
    if (!divided(m)) return LG_OK;
    const size_t behind = m->held - rows_length(m);
    if (ranks->rank == 0 && m->whole == NULL) m->whole = lg_alloc(m->context, m->length, sizeof *m->whole);
    const lg_status room = ranks->rank > 0 || m->whole != NULL
                               ? LG_OK
                               : lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the rows of all ranks");
    lg_status status = lg_ranks_agree(ranks, room, error);
    lg_minimise_count_bytes(m, lg_minimise_stride(m->n));
    if (status == LG_OK) status = ranks->collect(ranks->user, m->curvature, m->whole, m->bytes);
    if (status != LG_OK)
        lg_minimiser_scatter(m); /* otherwise zeros would be saved in place of the missing rows */
    LG_TRY(status);
    if (m->whole != NULL)
        memcpy(m->whole + (m->length - behind), m->curvature + rows_length(m), behind * sizeof *m->whole);
    return LG_OK;
}

void lg_minimiser_scatter(lg_minimiser *m) {
    lg_free(m->context, m->whole);
    m->whole = NULL;
}

/* Copies this rank's rows, and the numbers behind the rows, from the array of all ranks. */
static void take_rows(const lg_minimiser *m, const double *all, double *curvature) {
    const size_t behind = m->held - rows_length(m);
    memcpy(curvature, all + m->first * lg_minimise_stride(m->n), rows_length(m) * sizeof *all);
    memcpy(curvature + rows_length(m), all + (m->length - behind), behind * sizeof *all);
}

/* ---- saving ---- */

lg_status lg_minimiser_save(const lg_minimiser *m, const lg_archive_writer *writer, lg_error *error) {
    LG_NEEDS(error, m, writer);
    double *curvature = divided(m) ? m->whole : m->curvature;
    if (curvature == NULL)
        return lg_fail(error, LG_UNSUPPORTED,
                       "only rank 0 can save, and only after it has collected the rows of all ranks");
    lg_minimise_counts counts = m->counts;
    lg_minimise_numbers numbers = m->numbers;
    lg_stored items[ITEMS];
    list(m, m->memory, curvature, &counts, &numbers, items);
    return lg_stored_save(writer, items, ITEMS, error);
}

/* ---- loading ---- */

static lg_status check(const lg_minimiser *m, const lg_minimise_counts *c, const lg_minimise_numbers *numbers,
                       lg_error *error) {
    const bool searching = c->stage == LG_STAGE_SEARCH;
    const lg_rule rules[] = {
        {c->stage < LG_MINIMISE_STAGE_COUNT && c->end < LG_MINIMISE_END_COUNT &&
             (c->stage == LG_STAGE_DONE) == (c->end != LG_MINIMISE_RUNNING),
         "minimise/counts has an unknown stage or end"},
        {c->trials < 1000 && c->iterations <= c->evaluations && c->reference <= c->iterations &&
             c->pairs <= c->evaluations,
         "minimise/counts does not fit together"},
        {c->stage != LG_STAGE_HESSIAN || (lg_minimise_newton_fits(m) && c->trials <= 2 * m->n),
         "minimise/counts has more points of a Hessian than the method uses"},
        {c->stage != LG_STAGE_CURVATURE || (lg_minimise_curvature_fits(m) && c->trials < LG_LANCZOS_STEPS),
         "minimise/counts has more Lanczos vectors than the method uses"},
        {!searching || (isfinite(numbers->alpha) && isfinite(numbers->value) && numbers->slope < 0.0),
         "minimise/numbers is not a valid state of a line search"},
    };
    return lg_check_rules(rules, LG_COUNT(rules), LG_FORMAT, error);
}

lg_status lg_minimiser_load(lg_minimiser *m, const lg_archive_reader *reader, lg_error *error) {
    LG_NEEDS(error, m, reader);
    const size_t vectors = (size_t)(m->curvature - m->memory);
    lg_minimise_counts counts;
    lg_minimise_numbers numbers;
    lg_stored items[ITEMS];
    LG_SCRATCH(double, memory, m->context, vectors + m->length);
    if (memory == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the saved minimiser");
    double *curvature = memory + vectors;
    list(m, memory, curvature, &counts, &numbers, items);
    LG_TRY(lg_stored_load(reader, items, ITEMS, error));
    LG_TRY(check(m, &counts, &numbers, error));
    memcpy(m->memory, memory, vectors * sizeof *memory);
    take_rows(m, curvature, m->curvature);
    m->counts = counts;
    m->numbers = numbers;
    return LG_OK;
}
