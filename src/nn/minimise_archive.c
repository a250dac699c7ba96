/* Saving and loading a minimiser: the state as a list of arrays. */
#include <math.h>
#include <string.h>

#include "nn/minimise_internal.h"

typedef struct item {
    const char *path;
    lg_element type;
    uint64_t count;
    void *data;
} item;

enum { ITEMS = 7 };

/* `memory` has the layout of m->memory. */
static void list(const lg_minimiser *m, double *memory, lg_minimise_counts *counts,
                 lg_minimise_numbers *numbers, item out[ITEMS]) {
    const item all[ITEMS] = {
        {"minimise/counts", LG_ELEMENT_U64, sizeof *counts / sizeof(uint64_t), counts},
        {"minimise/numbers", LG_ELEMENT_F64, sizeof *numbers / sizeof(double), numbers},
        {"minimise/x", LG_ELEMENT_F64, m->n, memory + (m->x - m->memory)},
        {"minimise/gradient", LG_ELEMENT_F64, m->n, memory + (m->g - m->memory)},
        {"minimise/direction", LG_ELEMENT_F64, m->n, memory + (m->d - m->memory)},
        {"minimise/point", LG_ELEMENT_F64, m->n, memory + (m->point - m->memory)},
        {"minimise/curvature", LG_ELEMENT_F64, m->length, memory + (m->curvature - m->memory)},
    };
    memcpy(out, all, sizeof all);
}

lg_status lg_minimiser_save(const lg_minimiser *m, const lg_archive_writer *writer, lg_error *error) {
    (void)lg_fail(error, LG_OK, "%s", "");
    lg_minimise_counts counts = m->counts;
    lg_minimise_numbers numbers = m->numbers;
    item items[ITEMS];
    list(m, m->memory, &counts, &numbers, items);
    for (size_t i = 0; i < ITEMS; i++) {
        const item *it = &items[i];
        const lg_status status = writer->array(writer->user, it->path, it->type, 1, &it->count, it->data);
        if (status != LG_OK)
            return lg_fail(error, status, "%s could not be saved: %s", it->path, lg_status_sentence(status));
    }
    return LG_OK;
}

static lg_status check(const lg_minimiser *m, const double *memory, const lg_minimise_counts *c,
                       const lg_minimise_numbers *numbers, lg_error *error) {
    const bool searching = c->stage == LG_STAGE_SEARCH;
    const struct {
        bool good;
        const char *rule;
    } rules[] = {
        {c->stage < LG_MINIMISE_STAGE_COUNT && c->end < LG_MINIMISE_END_COUNT &&
             (c->stage == LG_STAGE_DONE) == (c->end != LG_MINIMISE_RUNNING),
         "minimise/counts has an unknown stage or end"},
        {c->trials < 100 && c->iterations <= c->evaluations && c->reference <= c->iterations &&
             c->pairs <= c->iterations,
         "minimise/counts does not fit together"},
        {c->stage != LG_STAGE_CHECK || c->trials < LG_COUNT(numbers->check_value),
         "minimise/counts has more points of a check than there are"},
        {!searching || (isfinite(numbers->alpha) && isfinite(numbers->value) && numbers->slope < 0.0),
         "minimise/numbers is no state of a search"},
        {m->k->all_finite((size_t)(m->s - m->memory), memory) &&
             m->k->all_finite(m->length, memory + (m->curvature - m->memory)),
         "minimise/ has values that are not finite"},
    };
    for (size_t i = 0; i < LG_COUNT(rules); i++)
        if (!rules[i].good) return lg_fail(error, LG_FORMAT, "%s", rules[i].rule);
    return LG_OK;
}

static lg_status load(const lg_minimiser *m, const lg_archive_reader *reader, double *memory,
                      lg_minimise_counts *counts, lg_minimise_numbers *numbers, lg_error *error) {
    item items[ITEMS];
    list(m, memory, counts, numbers, items);
    for (size_t i = 0; i < ITEMS; i++) {
        const item *it = &items[i];
        const lg_status status = reader->array(reader->user, it->path, it->type, 1, &it->count, it->data);
        if (status != LG_OK) return lg_fail(error, status, "%s: %s", it->path, lg_status_sentence(status));
    }
    return check(m, memory, counts, numbers, error);
}

lg_status lg_minimiser_load(lg_minimiser *m, const lg_archive_reader *reader, lg_error *error) {
    (void)lg_fail(error, LG_OK, "%s", "");
    const size_t total = (size_t)(m->curvature - m->memory) + m->length;
    lg_minimise_counts counts;
    lg_minimise_numbers numbers;
    double *memory = lg_alloc(m->context, total, sizeof *memory);
    if (memory == NULL) return lg_fail(error, LG_OUT_OF_MEMORY, "no memory for the saved minimiser");
    const lg_status status = load(m, reader, memory, &counts, &numbers, error);
    if (status == LG_OK) {
        memcpy(m->memory, memory, total * sizeof *memory);
        m->counts = counts;
        m->numbers = numbers;
    }
    lg_free(m->context, memory);
    return status;
}
