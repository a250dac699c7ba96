/* NAME_step: a scheme as constant tables for the interpreters below code/hamiltonian (step_*.c). */
#include "lg-export/steps.h"

#include <stdlib.h>
#include <string.h>

const char *step_scheme_name(const lg_scheme *scheme) {
    return scheme->name != NULL ? scheme->name : "a scheme without a name";
}

static void add_reals(export_source *source, const char *table, const double *values, size_t count) {
    lg_text_add(&source->code, "static const real %s[%zu] = {\n", table, count);
    lg_text_add_reals(&source->code, source->options->dtype, 4, values, count);
    lg_text_add(&source->code, "};\n");
}

static void add_integers(export_source *source, const char *table, const int *values, size_t count) {
    lg_text_add(&source->code, "static const int %s[%zu] = {", table, count);
    for (size_t i = 0; i < count; i++) lg_text_add(&source->code, "%s%d", i == 0 ? "" : ", ", values[i]);
    lg_text_add(&source->code, "};\n");
}

/* Row `row` of the tableau: of a, or behind the stages the weights, as the last stage has them with fsal. */
static const double *rkmk_row(const step_plan *of, int row) {
    const lg_scheme *scheme = of->scheme;
    if (row < of->stages) return scheme->a[row];
    return scheme->fsal ? scheme->a[scheme->stages - 1] : scheme->b;
}

/* The row of the exported tableau that a commutator belongs to; -1: of a stage that is left out. */
static int commutator_row(const step_plan *of, const lg_commutator *c) {
    const lg_scheme *scheme = of->scheme;
    if (c->row < of->stages) return c->row;
    const int step = scheme->fsal ? scheme->stages - 1 : scheme->stages;
    return c->row == step ? of->stages : -1;
}

static bool step_needs(const lg_scheme *scheme, int stage) {
    bool needed = scheme->b[stage] != 0.0;
    for (int i = 0; i < scheme->commutator_count; i++) {
        const lg_commutator *c = &scheme->commutators[i];
        const int step = scheme->fsal ? scheme->stages - 1 : scheme->stages;
        needed = needed || (c->row == step && (c->first == stage || c->second == stage));
    }
    return needed;
}

static void plan_rkmk(step_plan *of, size_t state) {
    const lg_scheme *scheme = of->scheme;
    of->stages = scheme->stages;
    while (of->stages > 1 && !step_needs(scheme, of->stages - 1)) of->stages--;
    of->evaluations = of->stages;
    of->work = ((size_t)of->stages + 2) * state;
}

static bool cf_row_needs(const lg_cf_row *row, int stage) {
    bool needed = row->base == stage;
    for (int e = 0; e < row->exponentials; e++) needed = needed || row->coefficient[e][stage] != 0.0;
    return needed;
}

/* A base without exponentials of its own is its own base. */
static int cf_base(const lg_scheme *scheme, int row) {
    int base = scheme->rows[row].base;
    while (base >= 0 && scheme->rows[base].exponentials == 0) base = scheme->rows[base].base;
    return base;
}

static const lg_cf_row *cf_row(const step_plan *of, int row) {
    return &of->scheme->rows[row < of->stages ? row : of->scheme->stages];
}

/* Slot 0 is for points that no later row begins at; slots[i] for stage i. Returns the number of slots. */
static int cf_slots(const step_plan *of, int *slots) {
    int count = 1;
    for (int i = 0; i < of->stages; i++) {
        bool kept = cf_base(of->scheme, of->scheme->stages) == i;
        for (int j = i + 1; j < of->stages; j++) kept = kept || cf_base(of->scheme, j) == i;
        slots[i] = kept ? count++ : 0;
    }
    return count;
}

static void plan_cf(step_plan *of, size_t state) {
    int slots[LG_SCHEME_MAX_STAGES];
    const lg_scheme *scheme = of->scheme;
    of->stages = scheme->stages;
    while (of->stages > 1 && !cf_row_needs(&scheme->rows[scheme->stages], of->stages - 1)) of->stages--;
    of->evaluations = of->stages;
    of->work = (1 + (size_t)of->stages + (size_t)cf_slots(of, slots)) * state;
}

static void plan_splitting(step_plan *of, size_t state) {
    bool known = false;
    of->stages = of->scheme->stages;
    for (int i = 0; i < of->stages; i++) {
        if (of->scheme->kick[i] != 0.0 && !known) of->evaluations++;
        known = (known || of->scheme->kick[i] != 0.0) && of->scheme->drift[i] == 0.0;
    }
    of->work = state;
}

static void add_commutators(export_source *source, const step_plan *of) {
    const lg_scheme *scheme = of->scheme;
    double *weights = app_alloc((size_t)scheme->commutator_count + 1, sizeof *weights);
    int *rows = app_alloc((size_t)scheme->commutator_count + 1, 3 * sizeof *rows), count = 0;
    for (int i = 0; i < scheme->commutator_count; i++) {
        const lg_commutator *c = &scheme->commutators[i];
        const int row = commutator_row(of, c);
        if (row < 0) continue;
        rows[3 * count] = row, rows[3 * count + 1] = c->first, rows[3 * count + 2] = c->second;
        weights[count++] = c->weight;
    }
    if (count > 0) {
        lg_text_add(&source->code, "/* Commutators: row, first and second stage, from 0; weights. */\n");
        export_constant(source, "COMMUTATORS", (size_t)count);
        add_integers(source, "commutator", rows, 3 * (size_t)count);
        add_reals(source, "commutator_weight", weights, (size_t)count);
        export_code(source, "se3_bracket");
    }
    export_code(source, count > 0 ? "se3_commutators" : "step_no_commutators");
    free(rows);
    free(weights);
}

/* Terms that reach rounding for |u| <= 2, by type. */
static const size_t exact_terms[] = {[LG_F64] = 11, [LG_F32] = 5};

static void add_dexpinv(export_source *source, const step_plan *of, bool chain) {
    const int K = of->scheme->dexpinv;
    if (!chain || K == 0 || of->stages == 1) {
        export_code(source, "step_no_dexpinv");
        return;
    }
    export_constant(source, "DEXPINV_TERMS",
                    K == LG_DEXPINV_EXACT ? exact_terms[source->options->dtype] : (size_t)K);
    export_code(source, "se3_bracket");
    export_code(source, K == LG_DEXPINV_EXACT ? "se3_dexpinv" : "se3_dexpinv_series");
}

static void add_rkmk(export_source *source, const step_plan *of, bool chain) {
    double table[(LG_SCHEME_MAX_STAGES + 1) * LG_SCHEME_MAX_STAGES];
    const int n = of->stages;
    for (int i = 0; i <= n; i++)
        for (int j = 0; j < n; j++) table[i * n + j] = rkmk_row(of, i)[j];
    add_reals(source, "tableau", table, (size_t)((n + 1) * n));
    if (chain)
        add_commutators(source, of);
    else
        export_code(source, "step_no_commutators");
    add_dexpinv(source, of, chain);
    export_code(source, "step_combine");
    export_code(source, "step_rkmk");
}

static void add_cf(export_source *source, const step_plan *of, bool chain) {
    double table[(LG_SCHEME_MAX_STAGES + 1) * LG_SCHEME_MAX_EXPONENTIALS * LG_SCHEME_MAX_STAGES];
    int slots[LG_SCHEME_MAX_STAGES], bases[LG_SCHEME_MAX_STAGES + 1], begin[LG_SCHEME_MAX_STAGES + 2] = {0};
    const int n = of->stages;
    int count = 0;
    (void)chain;
    export_constant(source, "SLOTS", (size_t)cf_slots(of, slots));
    for (int i = 0; i <= n; i++) {
        const lg_cf_row *row = cf_row(of, i);
        const int base = cf_base(of->scheme, i < n ? i : of->scheme->stages);
        bases[i] = base < 0 ? -1 : slots[base];
        for (int e = 0; e < row->exponentials; e++, count++)
            memcpy(table + count * n, row->coefficient[e], (size_t)n * sizeof *table);
        begin[i + 1] = count;
    }
    add_integers(source, "cf_base", bases, (size_t)n + 1);
    add_integers(source, "cf_begin", begin, (size_t)n + 2);
    add_integers(source, "cf_slot", slots, (size_t)n);
    add_reals(source, "cf_coefficient", table, (size_t)(count * n));
    export_code(source, "step_combine");
    export_code(source, "step_cf");
}

static void add_splitting(export_source *source, const step_plan *of, bool chain) {
    double table[2 * LG_SCHEME_MAX_STAGES];
    int acts[2 * LG_SCHEME_MAX_STAGES];
    (void)chain;
    for (int i = 0; i < 2 * of->stages; i++) {
        table[i] = i % 2 == 0 ? of->scheme->kick[i / 2] : of->scheme->drift[i / 2];
        acts[i] = table[i] != 0.0;
    }
    lg_text_add(&source->code, "/* kick and drift in turn, and whether they are not 0 */\n");
    add_reals(source, "splitting", table, 2 * (size_t)of->stages);
    add_integers(source, "splitting_acts", acts, 2 * (size_t)of->stages);
    export_code(source, "step_splitting");
}

typedef struct scheme_writer {
    bool chain; /* fits (T*S^2)^k, too */
    void (*make)(step_plan *of, size_t state);
    void (*add)(export_source *source, const step_plan *of, bool chain);
} scheme_writer;

/* Kinds without functions have no explicit step. */
static const scheme_writer writers[LG_SCHEME_KINDS] = {
    [LG_SCHEME_RKMK] = {true, plan_rkmk, add_rkmk},
    [LG_SCHEME_COMMUTATOR_FREE] = {true, plan_cf, add_cf},
    [LG_SCHEME_SPLITTING] = {false, plan_splitting, add_splitting},
};

int step_choose(const app *self, const export_source *source, const lg_hamiltonian *model, step_plan *out) {
    const bool chain = model->family->force == NULL;
    const lg_scheme *scheme = source->options->scheme;
    lg_error error = {LG_OK, ""};
    if (lg_scheme_check(scheme, &error) != LG_OK) return app_usage(self, "%s", error.message);
    const scheme_writer *writer = &writers[scheme->kind];
    if (writer->add == NULL || (chain && (!writer->chain || scheme->ambient)))
        return app_usage(self,
                         chain ? "%s is no explicit Lie group scheme, which a step on T*S^2 needs: cf4, "
                                 "rkmk4, lie-euler and other rows or files of the kinds rkmk and "
                                 "commutator-free can be had"
                               : "%s is not explicit: stormer-verlet, rk4, cf4 and other rows or files of "
                                 "the kinds splitting, runge-kutta, rkmk and commutator-free can be had",
                         step_scheme_name(scheme));
    *out = (step_plan){.scheme = scheme};
    writer->make(out, lg_hamiltonian_state_dim(model));
    return APP_EXIT_OK;
}

size_t step_code(export_source *source, const step_plan *step, bool chain, size_t begin) {
    lg_text_add(&source->code, "\n/* The scheme of %s_step: ", source->options->name);
    lg_text_add_comment(&source->code, step_scheme_name(step->scheme));
    lg_text_add(&source->code, " */\n");
    export_constant(source, "STEP_BEGIN", begin);
    export_constant(source, "STAGES", (size_t)step->stages);
    if (!chain && step->scheme->kind != LG_SCHEME_SPLITTING) export_code(source, "step_flat");
    export_code(source, "step_none");
    writers[step->scheme->kind].add(source, step, chain);
    return begin + step->work;
}
