/* A table of commands whose results must not depend on the units of mass, length and time. Each row has
 * files, data and commands in which every number that has a unit is marked: <x:a,b,c> stands for x mass^a
 * length^b time^c. The results of a row are compared with its results in units of 1. */
#ifndef LG_UNITS_SUPPORT_H
#define LG_UNITS_SUPPORT_H

#include "cli_files.h"

/* How many new units one old unit is: the mass x in old units is x * mass in new units. */
typedef struct units {
    double mass, length, time;
} units;

typedef struct dimension {
    double mass, length, time;
} dimension;

/* How a result is compared with the result in units of 1, after conversion.
 * SAME: every number agrees within `bound`, relative to the largest number.
 * LESS: the result is at most 3 times as large.
 * STATE: as LESS, for a mean of squares of positions and momenta. `of` is the dimension of the positions; the
 * larger of the two units is used for the conversion.
 * CURVE: as LESS, for a mean of squares of lengths and numbers without a unit. */
typedef enum comparison { SAME, LESS, STATE, CURVE } comparison;

typedef struct wanted {
    const char *key; /* the JSON member; a/b/c is a path of members */
    dimension of;
    comparison how;
    double bound;
} wanted;

typedef struct units_row {
    const char *name;
    bool quick;
    const char *files[3][2]; /* name, text */
    /* Data made in units of 1: the command, the file `made` that it writes, and the columns of the CSV file
     * with their dimensions (NULL: the file holds trajectories). The converted file is `name`. */
    struct {
        const char *command, *made, *name, *columns;
    } data[2];
    const char *commands[3]; /* program and arguments; --json is added */
    wanted results[3][4];    /* for each command */
} units_row;

#define P_CHAIN                                                                                              \
    { 1, 2, -1 }
#define ENERGY                                                                                               \
    { 1, 2, -2 }
#define PENDULUM                                                                                             \
    "system: pendulum-chain\nform: hamiltonian\ngravity: 9.81\nmasses: [1]\nlengths: [1]\nstarts: {kind: "   \
    "thesis}\n"
#define OSCILLATOR                                                                                           \
    "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"                  \
    "inputs: {columns: [u], hold: zero}\n"

#define DRIVEN(lag)                                                                                          \
    "columns: {time: t, run: run}\ncoordinates:\n  - {name: x, kind: line, velocity: vx}\n"                  \
    "inputs: {columns: [u], hold: zero, lag: " lag "}\ninput_map: {kind: known, values: [[1]]}\n"

static const units_row units_table[] = {
    {.name = "lg-simulate, chain",
     .quick = true,
     .files = {{"s.yaml", "system: pendulum-chain\ngravity: <9.81:0,1,-2>\nmasses: [<1:1,0,0>, <1.3:1,0,0>]\n"
                          "lengths: [<1:0,1,0>, <0.7:0,1,0>]\n"
                          "initial: {q: [[1, 0, 0], [0, 0.6, 0.8]], omega: [[0, <0.3:0,0,-1>, <1:0,0,-1>], "
                          "[<2:0,0,-1>, 0, 0]]}\n"}},
     .commands = {"lg-simulate s.yaml --t-end <2:0,0,1>"},
     .results = {{{"t", {0, 0, 1}, SAME, 1e-14}, {"invariants/energy/start", ENERGY, SAME, 1e-12}}}},
    {.name = "lg-simulate, rigid body",
     .quick = true,
     .files = {{"s.yaml", "system: rigid-body\ninertia: [<1:1,2,0>, <2:1,2,0>, <3:1,2,0>]\n"
                          "initial: {mu: [<0.01:1,2,-1>, <2:1,2,-1>, <0.01:1,2,-1>]}\n"}},
     .commands = {"lg-simulate s.yaml --t-end <20:0,0,1>"},
     .results = {{{"y", P_CHAIN, SAME, 1e-6}}}},
    {.name = "lg-simulate, heavy top",
     .files = {{"s.yaml",
                "system: heavy-top\nform: cotangent\ninertia: [<0.234375:1,2,0>, <0.46875:1,2,0>, "
                "<0.234375:1,2,0>]\n"
                "mass: <15:1,0,0>\nlength: <2:0,1,0>\nchi: [0, 1, 0]\ngamma0: [0, 0, <-9.81:0,1,-2>]\n"
                "initial:\n  Q: [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n  pi: [0, <70.3125:1,2,-1>, "
                "<-1.08:1,2,-1>]\n"}},
     .commands = {"lg-simulate s.yaml --t-end <1:0,0,1>"},
     .results = {{{"invariants/energy/start", ENERGY, SAME, 1e-12},
                  {"invariants/energy/end", ENERGY, SAME, 1e-7}}}},
    {.name = "lg-hamiltonian, one link",
     .quick = true,
     .files = {{"p.yaml", PENDULUM}},
     .data = {{"lg-hamiltonian generate p.yaml --trajectories 150 --points 5 --t-end 0.1", "a.h5", "train.h5",
               NULL},
              {"lg-hamiltonian generate p.yaml --trajectories 20 --points 6 --t-end 1 --seed 2", "b.h5",
               "test.h5", NULL}},
     .commands = {"lg-hamiltonian train train.h5 --epochs 300 --out m.h5",
                  "lg-hamiltonian evaluate m.h5 test.h5",
                  "lg-hamiltonian predict m.h5 --initial "
                  "0.6,0.48,0.64,<-0.8:1,2,-1>,<0.36:1,2,-1>,<0.48:1,2,-1> --t-end <1:0,0,1>"},
     .results = {{{"loss", {0}, STATE, 0}, {"floor", {0}, STATE, 0}},
                 {{"E1", {0}, STATE, 0}, {"E2", ENERGY, LESS, 0}, {"t_end", {0, 0, 1}, SAME, 1e-13}},
                 {{"t", {0, 0, 1}, SAME, 1e-14}, {"energy_drift", ENERGY, LESS, 0}}}},
    {.name = "lg-hamiltonian, two links",
     .files = {{"p.yaml",
                "system: pendulum-chain\nform: hamiltonian\ngravity: 1\nmasses: [1, 1]\nlengths: [1, 1]\n"
                "starts: {kind: thesis}\n"}},
     .data = {{"lg-hamiltonian generate p.yaml --trajectories 200 --points 5 --t-end 0.1", "a.h5", "train.h5",
               NULL},
              {"lg-hamiltonian generate p.yaml --trajectories 20 --points 6 --t-end 1 --seed 2", "b.h5",
               "test.h5", NULL}},
     .commands = {"lg-hamiltonian train train.h5 --epochs 300 --out m.h5",
                  "lg-hamiltonian evaluate m.h5 test.h5"},
     .results = {{{"loss", {0}, STATE, 0}}, {{"E1", {0}, STATE, 0}, {"E2", ENERGY, LESS, 0}}}},
    {.name = "lg-hamiltonian, quartic potential",
     .quick = true,
     .files = {{"p.yaml", "system: quartic\nstarts: {kind: thesis}\n"}},
     .data = {{"lg-hamiltonian generate p.yaml --trajectories 200 --points 6 --t-end 0.3", "a.h5", "train.h5",
               NULL},
              {"lg-hamiltonian generate p.yaml --trajectories 20 --points 6 --t-end 1 --seed 2", "b.h5",
               "test.h5", NULL}},
     .commands =
         {"lg-hamiltonian train train.h5 --epochs 200 --out m.h5", "lg-hamiltonian evaluate m.h5 test.h5",
          "lg-hamiltonian predict m.h5 --initial <0.5:0,1,0>,<0.3:0,1,0>,<0.1:1,1,-1>,<-0.2:1,1,-1> --t-end "
          "<5:0,0,1>"},
     .results = {{{"loss", {0, 1, 0}, STATE, 0}},
                 {{"E1", {0, 1, 0}, STATE, 0}, {"E2", ENERGY, LESS, 0}},
                 {{"energy_drift", ENERGY, LESS, 0}, {"steps", {0}, SAME, 0.05}}}},
    {.name = "lg-hamiltonian, coupled oscillators in single precision",
     .files = {{"p.yaml", "system: coupled-oscillators\nstarts: {kind: thesis}\n"}},
     .data = {{"lg-hamiltonian generate p.yaml --trajectories 200 --points 6 --t-end 0.3", "a.h5", "train.h5",
               NULL},
              {"lg-hamiltonian generate p.yaml --trajectories 20 --points 6 --t-end 1 --seed 2", "b.h5",
               "test.h5", NULL}},
     .commands =
         {"lg-hamiltonian train train.h5 --epochs 30 --units data --hidden 20,20 --dtype f32 --out m.h5",
          "lg-hamiltonian evaluate m.h5 test.h5"},
     .results = {{{"loss", {0, 1, 0}, STATE, 0}}, {{"E1", {0, 1, 0}, STATE, 0}, {"E2", ENERGY, LESS, 0}}}},
    {.name = "lg-hamiltonian, one link, potentials and methods",
     .files = {{"p.yaml", PENDULUM}},
     .data = {{"lg-hamiltonian generate p.yaml --trajectories 150 --points 5 --t-end 0.1", "a.h5", "train.h5",
               NULL}},
     .commands =
         {"lg-hamiltonian train train.h5 --preset best --potential dictionary --epochs 150 --out m.h5",
          "lg-hamiltonian train train.h5 --preset best --potential linear --epochs 30 --out m.h5",
          "lg-hamiltonian train train.h5 --preset best --method lm --hidden 8 --epochs 20 --out m.h5"},
     .results = {{{"loss", {0}, STATE, 0}}, {{"loss", {0}, STATE, 0}}, {{"loss", {0}, STATE, 0}}}},
    {.name = "lg-hamiltonian, symmetric potentials",
     .quick = true,
     .files = {{"p.yaml", PENDULUM}, {"q.yaml", "system: quartic\nstarts: {kind: thesis}\n"}},
     .data = {{"lg-hamiltonian generate p.yaml --trajectories 100 --points 5 --t-end 0.1", "a.h5", "link.h5",
               NULL},
              {"lg-hamiltonian generate q.yaml --trajectories 100 --points 6 --t-end 0.3", "b.h5", "plane.h5",
               NULL}},
     .commands = {"lg-hamiltonian train link.h5 --symmetry axial --epochs 60 --out m.h5",
                  "lg-hamiltonian train plane.h5 --symmetry spherical --epochs 60 --out m.h5"},
     .results = {{{"loss", {0}, STATE, 0}}, {{"loss", {0, 1, 0}, STATE, 0}}}},
    {.name = "lg-hamiltonian, one link, losses",
     .files = {{"p.yaml", PENDULUM}},
     .data = {{"lg-hamiltonian generate p.yaml --trajectories 150 --points 5 --t-end 0.1", "a.h5", "train.h5",
               NULL}},
     .commands = {"lg-hamiltonian train train.h5 --preset best --penalty 0.1 --epochs 150 --out m.h5",
                  "lg-hamiltonian train train.h5 --preset best --starts estimated --epochs 60 --out m.h5",
                  "lg-hamiltonian train train.h5 --preset best --distance geodesic --epochs 150 --out m.h5"},
     .results = {{{"loss", {0}, STATE, 0}}, {{"loss", {0}, STATE, 0}}, {{"loss", {0}, STATE, 0}}}},
    {.name = "lg-identify",
     .quick = true,
     .files = {{"scene.yaml", OSCILLATOR
                "mass: {kind: known, values: [2]}\n"
                "potential: {kind: known, form: quadratic, of: x, values: [2.5]}\n"
                "damping: {kind: known, values: [0.3]}\ninput_map: {kind: known, values: [[1]]}\n"},
               {"machine.yaml",
                OSCILLATOR "mass: diagonal\npotential: {kind: quadratic, of: x}\ndamping: diagonal\n"
                           "input_map: {kind: known, values: [[1]]}\n"}},
     .data = {{"lg-identify generate scene.yaml --runs 6 --t-end 6", "a.csv", "log.csv",
               "t:0,0,1 x:0,1,0 vx:0,1,-1 u:1,1,-2"}},
     .commands = {"lg-identify fit machine.yaml log.csv --out m.h5",
                  "lg-identify evaluate m.h5 log.csv --horizons <1:0,0,1>"},
     .results = {{{"identified/mass.1.1/value", {1, 0, 0}, SAME, 1e-5},
                  {"identified/damping.x/value", {1, 0, -1}, SAME, 1e-4},
                  {"identified/potential.x^2/value", {1, 0, -2}, SAME, 1e-5}}}},
    {.name = "lg-identify, a lag that is learned",
     .quick = true,
     .files = {{"scene.yaml", DRIVEN("0.3") "mass: {kind: known, values: [2]}\n"
                                            "damping: {kind: known, values: [0.3]}\n"},
               {"machine.yaml", DRIVEN("unknown") "mass: diagonal\ndamping: diagonal\n"}},
     .data = {{"lg-identify generate scene.yaml --runs 2 --t-end 6", "a.csv", "log.csv",
               "t:0,0,1 x:0,1,0 vx:0,1,-1 u:1,1,-2"}},
     .commands = {"lg-identify fit machine.yaml log.csv --out m.h5"},
     .results = {{{"identified/mass.1.1/value", {1, 0, 0}, SAME, 1e-5},
                  {"identified/damping.x/value", {1, 0, -1}, SAME, 1e-4},
                  {"identified/lag.u/value", {0, 0, 1}, SAME, 1e-5}}}},
    {.name = "lg-elastica solve",
     .quick = true,
     .commands =
         {"lg-elastica solve --case both-ends --x 1 --length <3.3:0,1,0> --stiffness <10:1,3,-2> --q0 0,0 "
          "--qN <3:0,1,0>,0"},
     .results = {{{"energy", ENERGY, SAME, 1e-10}, {"multiplier", {1, 1, -2}, SAME, 1e-9}}}},
    {.name = "lg-elastica, continuous",
     .commands = {"lg-elastica solve --continuous --case right-end --x 1 --length <3.3:0,1,0> --stiffness "
                  "<10:1,3,-2> "
                  "--q0 0,0 --qN <3:0,1,0>,0"},
     .results = {{{"energy", ENERGY, SAME, 1e-9}}}},
    {.name = "lg-elastica train",
     .commands =
         {"lg-elastica generate --case both-ends --count 80 --intervals 20 --length <3.3:0,1,0> --stiffness "
          "<10:1,3,-2> --q0 0,0 --qN <3:0,1,0>,0 --out e.h5",
          "lg-elastica train e.h5 --network discrete --epochs 60 --out m.h5"},
     .results = {{{"curves", {0}, SAME, 0}}, {{"test_mse", {0}, CURVE, 0}}}},
    {.name = "lg-fit",
     .quick = true,
     .files = {{"scene.yaml", OSCILLATOR
                "mass: {kind: known, values: [2]}\n"
                "potential: {kind: known, form: quadratic, of: x, values: [2.5]}\n"
                "damping: {kind: known, values: [0.3]}\ninput_map: {kind: known, values: [[1]]}\n"}},
     .data = {{"lg-identify generate scene.yaml --runs 2 --t-end 4", "a.csv", "table.csv",
               "t:0,0,1 x:0,1,0 vx:0,1,-1 u:1,1,-2"}},
     .commands = {"lg-fit train table.csv --inputs t,x --outputs vx --size 6,6 --epochs 100 --out m.h5"},
     .results = {{{"rmse/vx", {0, 1, -1}, LESS, 0}, {"r2/vx", {0}, SAME, 0.2}}}},
};

/* ---- conversion ---- */

static double unit_of(dimension of, units in) {
    return pow(in.mass, of.mass) * pow(in.length, of.length) * pow(in.time, of.time);
}

/* Copies the text and replaces every <x:a,b,c> by a number in the units `in`. */
static void expand(const char *text, units in, char *out, size_t size) {
    size_t used = 0;
    while (*text != '\0' && used + 40 < size) {
        double x;
        dimension of;
        int length = 0;
        if (*text == '<' &&
            sscanf(text, "<%lf:%lf,%lf,%lf>%n", &x, &of.mass, &of.length, &of.time, &length) == 4 &&
            length > 0) {
            used += (size_t)snprintf(out + used, size - used, "%.17g", x * unit_of(of, in));
            text += length;
        } else {
            out[used++] = *text++;
        }
    }
    assert_true(*text == '\0');
    out[used] = '\0';
}

/* The unit of a column, which is listed as "name:a,b,c"; 1 if it is not listed. */
static double column_unit(const char *columns, const char *name, units in) {
    dimension of;
    const char *wanted_name = test_text("%s:", name);
    const char *at = columns;
    while (at != NULL && strncmp(at, wanted_name, strlen(wanted_name)) != 0)
        at = (at = strchr(at, ' ')) != NULL ? at + 1 : NULL;
    if (at == NULL) return 1.0;
    assert_int_equal(sscanf(strchr(at, ':'), ":%lf,%lf,%lf", &of.mass, &of.length, &of.time), 3);
    return unit_of(of, in);
}

enum { TEXT_ROOM = 1 << 21, MOST_COLUMNS = 16 };

static void convert_table(const char *from, const char *to, const char *columns, units in) {
    char *text = lg_test_memory(TEXT_ROOM), *out = lg_test_memory(2 * TEXT_ROOM), *save = NULL;
    double by[MOST_COLUMNS];
    size_t count = 0, used = 0;
    (void)cli_read(from, text, TEXT_ROOM);
    for (char *line = strtok_r(text, "\n", &save); line != NULL; line = strtok_r(NULL, "\n", &save)) {
        const bool head = count == 0;
        size_t k = 0;
        for (char *cell = line, *end; cell != NULL; cell = end, k++) {
            end = strchr(cell, ',');
            if (end != NULL) *end++ = '\0';
            if (head) by[count++] = column_unit(columns, cell, in);
            const char *mark = end != NULL ? "," : "\n";
            if (head || by[k] == 1.0)
                used += (size_t)sprintf(out + used, "%s%s", cell, mark);
            else
                used += (size_t)sprintf(out + used, "%.17g%s", strtod(cell, NULL) * by[k], mark);
        }
    }
    cli_write(to, out);
}

/* The positions of chains have no unit. */
static void convert_trajectories(const char *from, const char *to, units in) {
    lg_trajectories *data = cli_trajectories(from);
    const bool chain = strcmp(data->family->name, "chain") == 0;
    const double q = chain ? 1.0 : in.length, p = in.mass * in.length * (chain ? in.length : 1.0) / in.time;
    const size_t d = data->state_dim, block = chain ? 3 : d / 2;
    for (size_t i = 0; i < data->count * data->points * d; i++)
        data->data[i] *= i % d / block % 2 == 0 ? q : p;
    for (size_t i = 0; i < data->count; i++) data->hamiltonian[i] *= unit_of((dimension){1, 2, -2}, in);
    for (size_t j = 0; j < data->points; j++) data->t[j] *= in.time;
    data->dt *= in.time;
    lg_system_destroy(data->truth);
    data->truth = NULL;
    assert_ok(lg_trajectories_write(NULL, cli_at(to), data, NULL));
}

/* ---- running a row ---- */

enum { COMMANDS = 3, RESULTS = 4, NUMBERS = 64 };
typedef struct units_values {
    size_t count[COMMANDS][RESULTS];
    double value[COMMANDS][RESULTS][NUMBERS];
} units_values;

static size_t read_value(const char *json, const char *path, double *out) {
    char key[64];
    const char *at = json;
    while (true) {
        const size_t length = strcspn(path, "/");
        (void)snprintf(key, sizeof key, "%.*s", (int)length, path);
        if (path[length] == '\0') break;
        at = json_find(at, key);
        if (at == NULL) fail_msg("no %s in %s", key, json);
        path += length + 1;
    }
    const char *value = json_find(at, key);
    if (value == NULL) fail_msg("no %s in %s", key, json);
    if (*value == '[') return json_array(at, key, out, NUMBERS);
    out[0] = json_number(at, key);
    return 1;
}

/* Returns false after printing a message if a command failed. */
static bool run_row(const units_row *row, units in, units_values *out) {
    char text[4096], program[32];
    cli_forget("m.h5 curves.h5 train.h5 test.h5 made.h5"); /* of another program's row */
    for (size_t i = 0; i < LG_COUNT(row->files) && row->files[i][0] != NULL; i++) {
        expand(row->files[i][1], in, text, sizeof text);
        cli_write(row->files[i][0], text);
    }
    for (size_t i = 0; i < LG_COUNT(row->data) && row->data[i].command != NULL; i++) {
        const size_t length = strcspn(row->data[i].command, " ");
        (void)snprintf(program, sizeof program, "%.*s", (int)length, row->data[i].command);
        (void)snprintf(text, sizeof text, "%s --out %s", row->data[i].command + length, row->data[i].made);
        cli_expect(program, text, 0, "");
        if (row->data[i].columns != NULL)
            convert_table(row->data[i].made, row->data[i].name, row->data[i].columns, in);
        else
            convert_trajectories(row->data[i].made, row->data[i].name, in);
    }
    for (size_t c = 0; c < COMMANDS && row->commands[c] != NULL; c++) {
        const size_t length = strcspn(row->commands[c], " ");
        (void)snprintf(program, sizeof program, "%.*s", (int)length, row->commands[c]);
        expand(row->commands[c] + length, in, text, sizeof text - 8);
        (void)strcat(text, " --json");
        cli_run_limited(program, text, 0);
        if (result.code != 0) {
            print_error("%s, units %g %g %g: %s%s: exit code %d: %s", row->name, in.mass, in.length, in.time,
                        program, text, result.code, result.err);
            return false;
        }
        for (size_t r = 0; r < RESULTS && row->results[c][r].key != NULL; r++)
            out->count[c][r] = read_value(result.out, row->results[c][r].key, out->value[c][r]);
    }
    return true;
}

/* Whether the result in the units `in` agrees with the result in units of 1. `off` gets the difference, or
 * the ratio where w->how is not SAME. */
static bool agrees(const wanted *w, units in, size_t count, const double *got, const double *base,
                   double *off) {
    const double q = unit_of(w->of, in), p = unit_of((dimension){1, 2, -1}, in) / q;
    const double larger = w->how == STATE ? fmax(q, p) : fmax(1.0, in.length);
    const double unit = w->how == STATE || w->how == CURVE ? larger * larger : q;
    double most = 0.0;
    *off = 0.0;
    if (w->how != SAME) {
        *off = got[0] / unit / base[0];
        return *off <= 3.0;
    }
    for (size_t i = 0; i < count; i++) most = fmax(most, fabs(base[i]));
    for (size_t i = 0; i < count; i++) {
        const double gap = fabs(got[i] / unit - base[i]) / (most > 0.0 ? most : 1.0);
        if (!(gap <= *off)) *off = gap;
    }
    return *off <= w->bound;
}

/* Compares the row in these units with units of 1. Prints each difference and returns their number. */
static int compare_row(const units_row *row, units in, const units_values *base) {
    units_values *values = lg_test_memory(sizeof *values);
    int failures = 0;
    if (!run_row(row, in, values)) return 1;
    for (size_t c = 0; c < COMMANDS; c++)
        for (size_t r = 0; r < RESULTS && row->results[c][r].key != NULL; r++) {
            const wanted *w = &row->results[c][r];
            double off = (double)INFINITY;
            if (values->count[c][r] == base->count[c][r] &&
                agrees(w, in, base->count[c][r], values->value[c][r], base->value[c][r], &off))
                continue;
            print_error("%s, units %g %g %g: %s is %.17g, in units of 1 %.17g (%.3g)\n", row->name, in.mass,
                        in.length, in.time, w->key, values->value[c][r][0], base->value[c][r][0], off);
            failures++;
        }
    return failures;
}

/* Compares all rows in all units; or the quick rows, each in one of them. */
static void compare_table(const units *in, size_t count, bool quick) {
    int failures = 0;
    for (size_t i = 0; i < LG_COUNT(units_table); i++) {
        if (quick && !units_table[i].quick) continue;
        const size_t mark = lg_test_owned();
        units_values *base = lg_test_memory(sizeof *base);
        assert_true(run_row(&units_table[i], (units){1, 1, 1}, base));
        for (size_t u = 0; u < count; u++)
            if (!quick || u == i % count) failures += compare_row(&units_table[i], in[u], base);
        lg_test_give_back(mark);
    }
    assert_int_equal(failures, 0);
}

#endif
