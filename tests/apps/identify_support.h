/* Descriptions of machines and logs for the tests of lg-identify. */
#ifndef LG_IDENTIFY_SUPPORT_H
#define LG_IDENTIFY_SUPPORT_H

#include "cli_support.h"

#include "liegrad/machine.h"
#include "support/fixtures.h"

OWNED_FILE(machine_model)

static const char identify[] = "lg-identify";

#define OSCILLATOR_COLUMNS                                                                                   \
    "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"                  \
    "inputs: {columns: [u], hold: zero}\n"
/* 2 x'' = -5 x - .3 x' + u */
static const char oscillator_scene[] =
    OSCILLATOR_COLUMNS "mass: {kind: known, values: [2]}\n"
                       "potential: {kind: known, form: quadratic, of: x, values: [2.5]}\n"
                       "damping: {kind: known, values: [0.3]}\ninput_map: {kind: known, values: [[1]]}\n";
static const char oscillator_machine[] =
    OSCILLATOR_COLUMNS "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n"
                       "input_map: {kind: known, values: [[1]]}\n";

static const char oscillator_network[] =
    OSCILLATOR_COLUMNS "mass: diagonal\npotential: {kind: network, of: x, hidden: [6]}\ndamping: diagonal\n"
                       "input_map: {kind: known, values: [[1]]}\n";

/* Reads a column of a CSV file with a header; empty cells become NaN. Returns the number of rows. */
static inline size_t csv_column(const char *name, const char *column, double *out, size_t room) {
    enum { SIZE = 1 << 21 };
    char *text = lg_test_memory(SIZE), *save = NULL;
    size_t n = 0;
    int at = -1, k = 0;
    (void)cli_read(name, text, SIZE);
    char *line = strtok_r(text, "\n", &save);
    for (char *cell = line; cell != NULL; k++) {
        char *end = strchr(cell, ',');
        if (end != NULL) *end++ = '\0';
        if (strcmp(cell, column) == 0) at = k;
        cell = end;
    }
    if (at < 0) fail_msg("%s has no column %s", name, column);
    while ((line = strtok_r(NULL, "\n", &save)) != NULL && n < room) {
        for (k = 0; k < at; k++) line = strchr(line, ',') + 1;
        out[n++] = *line == ',' || *line == '\0' ? (double)NAN : strtod(line, NULL);
    }
    return n;
}

static inline const lg_machine_model_file *cli_machine_model(const char *name) {
    lg_machine_model_file file;
    assert_ok(lg_recipe_load(NULL, cli_at(name), NULL, &lg_recipe_machine_model, &file, NULL));
    return own_lg_machine_model_file(file);
}

/* Asserts that a model knows the range of all its positions, velocities and inputs. */
static inline void expect_known_range(const char *name) {
    const lg_machine_model_run *run = &cli_machine_model(name)->run;
    const size_t used = run->machine.positions + run->machine.velocities + run->machine.input_count;
    for (size_t i = 0; i < used; i++)
        if (!(run->range.low[i] < run->range.high[i]) || fabs(run->range.low[i]) > 1e200)
            fail_msg("%s: number %zu goes from %g to %g", name, i, run->range.low[i], run->range.high[i]);
}

/* Runs a command that must succeed and print nothing on standard error. */
static inline void identify_run_quietly(const char *line) {
    cli_expect(identify, line, 0, "");
    if (result.err[0] != '\0') fail_msg("lg-identify %s: %s", line, result.err);
}

#endif
