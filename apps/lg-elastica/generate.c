/* lg-elastica generate: computes curves over families of boundary conditions and writes a data file. */
#include <math.h>

#include "lg-elastica/beam.h"
#include "common/train.h"

typedef struct generate_values {
    const char *out;
    int kind;
    uint64_t count;
    double gap;
    bool continuous;
} generate_values;

static const char *const families_names[] = {"both-ends", "right-end", "both", NULL};

static const lg_field generate_options[] = {
    BEAM_CASE(generate_values, "both-ends (default), right-end, or both in succession",
              .names = families_names),
    LG_OPTION(generate_values, count, U64, "n", "Curves of each case", .low = 1, .high = 100000000,
              .value = "1000"),
    LG_OPTION(generate_values, gap, REAL, "G", "Distance kept from x = 0, pi and 2 pi, in units of pi",
              .high = 0.499, .value = "0.01"),
    CONTINUOUS(generate_values),
    APP_OUT(generate_values, "FILE", "The HDF5 file to write", .file = LG_FILE_WRITTEN, .kind = "elastica",
            .required = true),
    LG_FIELD_END};

static generate_values values;

enum { SHOWN_CURVES = 24 };

/* Draws some curves of a set, evenly chosen. */
static void put_set(app_plot *plot, const void *set) {
    const lg_elastica_curves *curves = set;
    const size_t nodes = (size_t)curves->intervals + 1;
    const size_t shown = curves->count < SHOWN_CURVES ? curves->count : (size_t)SHOWN_CURVES;
    app_plot_text(plot, "%zu of %zu curves\t0", shown, curves->count);
    for (size_t i = 0; i < shown; i++) {
        const size_t at = 2 * nodes * (i * curves->count / shown);
        app_plot_text(plot, "\t0");
        put_beam(plot, &(beam_curve){.problem = {.length = curves->length, .intervals = curves->intervals},
                                     .at = {.q = curves->q + at, .v = curves->v + at}});
    }
}

static void report(const app *self, const lg_elastica_data *data, double seconds) {
    const lg_elastica_curves *curves = &data->curves;
    double low = INFINITY, high = -INFINITY;
    for (size_t i = 0; curves->energy != NULL && i < curves->count; i++) {
        low = fmin(low, curves->energy[i]);
        high = fmax(high, curves->energy[i]);
    }
    app_json *out = self->out;
    APP_PUT(out, LG_TEXT("case", families_names[values.kind], NULL), LG_WHOLE("curves", curves->count, NULL),
            LG_WHOLE("intervals", curves->intervals, NULL),
            LG_TEXT("values", curves->continuous ? "continuous" : "discrete", NULL),
            LG_AS_REAL("length", curves->length), LG_AS_REAL("stiffness", curves->stiffness),
            LG_AS_REAL("gap", values.gap), LG_REAL("energy_min", low, NULL),
            LG_REAL("energy_max", high, NULL), LG_AS_WHOLE("threads", self->threads),
            LG_AS_TEXT("sha256", data->sha256), LG_TEXT("out", values.out, NULL),
            LG_REAL("seconds", seconds, NULL));
}

static void run(app *self) {
    APP_CLEAN(lg_elastica_data_destroy) lg_elastica_data data = {.sha256 = ""};
    lg_elastica_sampling sampling;
    lg_elastica_sampling_init(&sampling);
    sampling.both_ends = values.kind != 1;
    sampling.right_end = values.kind != 0;
    sampling.count = (size_t)values.count;
    sampling.gap = values.gap;
    sampling.continuous = values.continuous;
    sampling.threads = (int)self->threads;
    sampling.problem = beam_problem(self);
    const double begin = app_seconds();
    APP_DO(self, lg_elastica_generate, &sampling, &data.curves);
    const double seconds = app_seconds() - begin;
    data.provenance = app_provenance(self, self->seed);
    APP_FILE(self, values.out, lg_elastica_data_write, &data);
    app_plot_draw(self, 0, &data.curves);
    report(self, &data, seconds);
}

const app_command elastica_generate_command = {
    .name = "generate",
    .summary = "Compute equilibria over a range of boundary conditions as training data",
    .details =
        "The file holds /boundary (n, 8) as q0, v0, qN, vN, /q and /v (n, N + 1, 2), /energy, /x and /case "
        "(n). x takes equidistant values in [G pi, (1 - G) pi] and in its mirror image, ends included; each "
        "interval has half of the curves.",
    APP_DRAWS("some of the curves", "elastica_beams", put_set),
    .settings = APP_SETTINGS(BEAM, ENDS, APP_GIVEN(generate_options, values)),
    .run = run};
