/* lg-elastica generate: curves over families of boundary conditions into a data file. */
#include <math.h>
#include <stdlib.h>

#include "lg-elastica/beam.h"
#include "common/train.h"

typedef struct generate_values {
    const char *out, *plot;
    int kind;
    uint64_t count, intervals;
    double gap, length, stiffness;
    lg_reals q0, qN;
    bool continuous;
} generate_values;

static const char *const families_names[] = {"both-ends", "right-end", "both", NULL};

static const lg_field generate_options[] = {
    LG_OPTION(generate_values, kind, NAME, NULL, "both-ends (default), right-end, or both in succession",
              .option = "case", .names = families_names),
    LG_OPTION(generate_values, count, U64, "n", "Curves of each case", .low = 1, .high = 100000000,
              .value = "1000"),
    LG_OPTION(generate_values, intervals, U64, "N", "Number of equal intervals between the nodes",
              .low = LG_ELASTICA_MIN_INTERVALS, .high = LG_ELASTICA_MAX_INTERVALS, .value = "50"),
    LG_OPTION(generate_values, gap, REAL, "G", "Distance kept from x = 0, pi and 2 pi, in units of pi",
              .high = 0.499, .value = "0.01"),
    LG_OPTION(generate_values, continuous, SWITCH, NULL,
              "Store solutions of the differential equation at the nodes instead of discrete solutions"),
    LG_OPTION(generate_values, length, REAL, "L", "Length of the beam", LG_POSITIVE, .value = "3.3"),
    LG_OPTION(generate_values, stiffness, REAL, "EI", "Bending stiffness", LG_POSITIVE, .value = "10"),
    LG_OPTION(generate_values, q0, REALS, "X,Y", "Where the beam begins (default 0,0)", LG_ANY_REAL),
    LG_OPTION(generate_values, qN, REALS, "X,Y", "Where it ends (default 3,0)", LG_ANY_REAL),
    LG_OPTION(generate_values, out, STRING, "FILE", "The HDF5 file to write"),
    LG_OPTION(generate_values, plot, STRING, "FILE.svg|.png", "Draw some of the curves"),
    LG_FIELD_END};

static generate_values values;

static void report(const app *self, const lg_elastica_data *data, double seconds) {
    const lg_elastica_curves *curves = &data->curves;
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; curves->energy != NULL && i < curves->count; i++) {
        low = fmin(low, curves->energy[i]);
        high = fmax(high, curves->energy[i]);
    }
    if (!self->json) {
        (void)printf("%s: %zu curves (%s, %s values), %u intervals, energies %.6g to %.6g (%.2f s)\n",
                     values.out, curves->count, families_names[values.kind],
                     curves->continuous ? "continuous" : "discrete", curves->intervals, low, high, seconds);
        return;
    }
    app_json json;
    app_json_begin(&json);
    app_json_text(&json, "case", families_names[values.kind]);
    app_json_size(&json, "curves", curves->count);
    app_json_size(&json, "intervals", curves->intervals);
    app_json_text(&json, "values", curves->continuous ? "continuous" : "discrete");
    app_json_real(&json, "length", curves->length);
    app_json_real(&json, "stiffness", curves->stiffness);
    app_json_real(&json, "gap", values.gap);
    app_json_real(&json, "energy_min", low);
    app_json_real(&json, "energy_max", high);
    app_json_size(&json, "threads", self->threads);
    app_json_text(&json, "sha256", data->sha256);
    app_json_text(&json, "out", values.out);
    app_json_real(&json, "seconds", seconds);
    app_json_end(&json);
}

static int fill_sampling(const app *self, lg_elastica_sampling *sampling) {
    const boundary_values ends = {.q0 = values.q0, .qN = values.qN};
    lg_elastica_sampling_init(sampling);
    sampling->both_ends = values.kind != 1;
    sampling->right_end = values.kind != 0;
    sampling->count = (size_t)values.count;
    sampling->gap = values.gap;
    sampling->continuous = values.continuous;
    sampling->threads = (int)self->threads;
    sampling->problem.length = values.length;
    sampling->problem.stiffness = values.stiffness;
    sampling->problem.intervals = (uint32_t)values.intervals;
    return boundary_ends(self, &ends, &sampling->problem);
}

static int run(app *self) {
    const app_path paths[] = {{"out", values.out, LG_FILE_WRITTEN}, {"plot", values.plot, LG_FILE_DRAWN}};
    lg_error error = {LG_OK, ""};
    lg_elastica_sampling sampling;
    lg_elastica_data data = {.sha256 = ""};
    if (values.out == NULL) return app_usage(self, "--out FILE is missing");
    int code = fill_sampling(self, &sampling);
    if (code == APP_EXIT_OK) code = app_check_outputs(self, paths, LG_COUNT(paths));
    if (code != APP_EXIT_OK) return code;
    const double begin = app_seconds();
    lg_status status = lg_elastica_generate(self->context, &sampling, &data.curves, &error);
    if (status == LG_CANCELLED) return app_fail(self, status, "stopped by %s", app_stopper());
    if (status != LG_OK)
        return app_fail(self, status, "%s",
                        error.message[0] != '\0' ? error.message : lg_status_sentence(status));
    const double seconds = app_seconds() - begin;
    const char *path = values.out;
    data.provenance = app_provenance(self, self->seed);
    status = lg_elastica_data_write(self->context, path, &data, &error);
    if (status == LG_OK && values.plot != NULL) {
        path = values.plot;
        status = draw_set(self, path, &data.curves, &error);
    }
    if (status == LG_OK) report(self, &data, seconds);
    lg_elastica_data_destroy(&data);
    return status == LG_OK ? APP_EXIT_OK : app_fail_file(self, status, &error, path);
}

const app_command generate_command = {
    .name = "generate",
    .summary = "Compute equilibria over a range of boundary conditions as training data",
    .details =
        "The file holds /boundary (n, 8) as q0, v0, qN, vN, /q and /v (n, N + 1, 2), /energy, /x and /case "
        "(n). x takes equidistant values in [G pi, (1 - G) pi] and in its mirror image, ends included; each "
        "interval has half of the curves.",
    .settings = APP_SETTINGS(APP_GIVEN(generate_options, values)),
    .run = run};
