/* Machines: numbers that are unknown one by one, with starts, bounds and priors: entries of the values of a
 * term, and numbers of a named system. */
#include <math.h>
#include <string.h>

#include "autodiff/tape/tape_internal.h"
#include "machine/internal.h"

/* ---- x = a e^(g t) + b + s t + r/(1 + e^-(t + l)) ---- */

static bool is_bounded(const lg_machine_entry *e) {
    return e->low < e->high;
}

lg_number_map lg_machine_entry_map(const lg_machine_entry *e, double start, double unit, bool positive) {
    if (is_bounded(e)) {
        const double r = e->high - e->low;
        return (lg_number_map){.b = e->low, .r = r, .l = log((start - e->low) / (e->high - start))};
    }
    if (positive) return (lg_number_map){.a = start, .g = 1.0};
    return (lg_number_map){.b = start, .s = unit + fabs(start)};
}

double lg_number_at(const lg_number_map *m, double t, double *slope) {
    const double share = 1.0 / (1.0 + exp(-(t + m->l))), grown = m->a * exp(m->g * t);
    if (slope != NULL) *slope = m->g * grown + m->s + m->r * share * (1.0 - share);
    return grown + m->b + m->s * t + m->r * share;
}

enum { MOST = LG_MACHINE_ENTRIES };

static lg_var row_of(lg_tape *tape, const lg_number_map *maps, uint32_t count, size_t member) {
    double values[LG_MACHINE_VALUES];
    for (uint32_t i = 0; i < count; i++)
        values[i] = *(const double *)(const void *)((const char *)&maps[i] + member);
    return lg_input_f64(tape, lg_shape2(1, count), values);
}

#define ROW(member) row_of(tape, maps, count, offsetof(lg_number_map, member))
lg_var lg_machine_record_maps(lg_tape *tape, const lg_number_map *maps, uint32_t count, lg_var t) {
    const lg_var grown = lg_mul(tape, ROW(a), lg_exp(tape, lg_mul(tape, ROW(g), t))),
                 moved = lg_add(tape, ROW(b), lg_mul(tape, ROW(s), t)),
                 share = lg_mul(tape, ROW(r), lg_act(tape, lg_add(tape, t, ROW(l)), LG_SIGMOID));
    return lg_add(tape, lg_add(tape, grown, moved), share);
}

/* ---- entries of values ---- */

/* The map of entry k, and its start in the units of the log. */
static lg_number_map map_of(const lg_machine *machine, const lg_machine_term *term, uint32_t k,
                            lg_entry_about *about) {
    const lg_machine_entry *e = &term->entries[k];
    term->kind->entry(machine, term, e->index, about);
    double start = term->values[e->index];
    if (isnan(start)) start = is_bounded(e) ? 0.5 * (e->low + e->high) : about->start * about->unit;
    about->start = start;
    return lg_machine_entry_map(e, start, about->unit, about->positive);
}

lg_var lg_machine_record_entries(const lg_term_at *at, uint32_t count, const uint32_t *index,
                                 const double *factor) {
    lg_tape *tape = at->tape;
    const lg_machine *machine = at->machine;
    const lg_machine_term *own = at->term;
    double known[LG_MACHINE_VALUES], placed[MOST * LG_MACHINE_VALUES];
    lg_number_map maps[MOST];
    const lg_shape row = lg_shape2(1, count);
    uint32_t all_of[LG_MACHINE_VALUES];
    for (uint32_t i = 0; i < count && index == NULL; i++) all_of[i] = i;
    if (index == NULL) index = all_of;
    for (uint32_t i = 0; i < count; i++)
        known[i] = index[i] == UINT32_MAX ? 0.0 : own->values[index[i]] * factor[i];
    if (own->entry_count == 0) return lg_input_f64(tape, row, known);
    memset(placed, 0, (size_t)own->entry_count * count * sizeof *placed);
    for (uint32_t k = 0; k < own->entry_count; k++) {
        lg_entry_about about;
        maps[k] = map_of(machine, own, k, &about);
        for (uint32_t i = 0; i < count; i++) {
            if (index[i] != own->entries[k].index) continue;
            known[i] = 0.0;
            placed[k * count + i] = factor[i];
        }
    }
    const lg_var t = lg_reshape(tape, at->theta, lg_shape2(1, own->entry_count));
    const lg_var x = lg_machine_record_maps(tape, maps, own->entry_count, t);
    const lg_var all = lg_matmul(tape, x, lg_input_f64(tape, lg_shape2(own->entry_count, count), placed));
    return lg_add(tape, all, lg_input_f64(tape, row, known));
}

void lg_numbers_entries(lg_number_list *l, const lg_machine *machine, const lg_machine_term *term,
                        const double *theta) {
    lg_entry_about about;
    for (uint32_t k = 0; k < term->entry_count; k++) {
        const lg_number_map map = map_of(machine, term, k, &about);
        lg_numbers_put(l, lg_number_at(&map, theta[k], NULL), "%s", about.name);
    }
}

bool lg_machine_is_entry_of(const lg_machine_term *term, uint32_t index) {
    for (uint32_t k = 0; k < term->entry_count; k++)
        if (term->entries[k].index == index) return true;
    return false;
}

void lg_machine_scale_entries(const lg_machine *machine, const lg_machine_term *term, const double *theta,
                              double *direction) {
    lg_entry_about about;
    for (uint32_t k = 0; k < term->entry_count; k++) {
        double slope;
        const lg_number_map map = map_of(machine, term, k, &about);
        const double x = lg_number_at(&map, theta[k], &slope);
        direction[k] = slope != 0.0 ? x / slope : 0.0;
    }
}

const char *lg_machine_entries_fault(const lg_machine *machine, const lg_machine_term *term) {
    lg_entry_about about;
    if (term->entry_count > 0 && term->kind->entry == NULL)
        return "either all numbers of this kind are known, or none of them";
    if (term->entry_count > MOST) return "has too many unknown numbers among its values";
    for (uint32_t k = 0; k < term->entry_count; k++) {
        const lg_machine_entry *e = &term->entries[k];
        if (e->index >= term->value_count) return "an unknown number is not among its values";
        term->kind->entry(machine, term, e->index, &about);
        const double start = term->values[e->index];
        if (!about.single)
            return "only numbers on the diagonal of a matrix can be unknown by themselves; give the "
                   "diagonal, or kind constant";
        if (about.positive && (start <= 0.0 || (is_bounded(e) && e->low < 0.0)))
            return "an unknown number of this kind must have a start above 0, and bounds not below 0";
        if (is_bounded(e) && !isnan(start) && !(start > e->low && start < e->high))
            return "the start of a number must be inside of its bounds";
        if (e->sigma > 0.0 && isnan(start)) return "a prior (sigma) needs a start, its centre";
    }
    return NULL;
}

/* ---- priors ---- */

uint32_t lg_machine_list_priors(const lg_machine *machine, lg_prior *out) {
    uint32_t count = 0;
    for (const lg_machine_term *term = NULL; lg_machine_next_term(machine, LG_MACHINE_PART_COUNT, &term);) {
        const uint32_t index = (uint32_t)(term - machine->terms);
        for (uint32_t k = 0; k < term->entry_count; k++) {
            lg_entry_about about;
            if (!(term->entries[k].sigma > 0.0)) continue;
            const lg_number_map map = map_of(machine, term, k, &about);
            if (count < LG_MACHINE_PRIORS)
                out[count] = (lg_prior){index, k, map, about.start, term->entries[k].sigma};
            count++;
        }
        if (term->kind->priors != NULL) count = term->kind->priors(machine, index, out, count);
    }
    return count;
}

lg_var lg_machine_record_priors(lg_tape *tape, const lg_machine_vars *vars, uint32_t rows, double weight) {
    lg_prior priors[LG_MACHINE_PRIORS];
    lg_var each[LG_MACHINE_PRIORS];
    const uint32_t count = lg_machine_list_priors(vars->machine, priors);
    for (uint32_t i = 0; i < count; i++) {
        const lg_prior *p = &priors[i];
        const lg_var t =
            lg_reshape(tape, lg_slice(tape, vars->theta[p->term], 0, p->index, 1), lg_shape2(1, 1));
        const lg_var x = lg_machine_record_maps(tape, &p->map, 1, t);
        each[i] = lg_scale(tape, lg_add_scalar(tape, x, -p->centre), weight / p->sigma);
    }
    const lg_var zeros = lg_full(tape, lg_shape2(rows, count), 0.0);
    lg_tape_mark_rows(tape, zeros);
    return lg_add(tape, zeros, lg_joined(tape, each, count));
}

uint32_t lg_machine_problem_priors(const lg_machine_problem *problem) {
    lg_prior priors[LG_MACHINE_PRIORS];
    return problem->theta == NULL ? lg_machine_list_priors(problem->machine, priors) : 0;
}

double lg_machine_prior_weight(const lg_machine_problem *problem, size_t batch) {
    const double points = (double)problem->window - (lg_machine_starts_estimated(problem) ? 0.0 : 1.0),
                 windows = (double)(problem->windows - problem->validation);
    const double residual = problem->residual > 0.0 ? problem->residual : 1.0;
    return residual / sqrt(points * windows * (double)batch);
}

/* ---- coefficients of damping ---- */

lg_var lg_machine_record_drag(const lg_term_at *at, int power) {
    const uint32_t n = at->machine->velocities;
    double factor[LG_MACHINE_VELOCITIES];
    if (at->term->value_count == 0)
        return lg_reshape(at->tape, lg_square(at->tape, at->theta), lg_shape2(1, n));
    for (uint32_t i = 0; i < n; i++) factor[i] = 1.0 / lg_machine_drag_unit(at->machine, i, i, power);
    return lg_machine_record_entries(at, n, NULL, factor);
}
