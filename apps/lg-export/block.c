/* Collects the variables and functions of a block, and writes the C that evaluates it. */
#include "lg-export/block.h"

#include <string.h>

/* ---- variables ---- */

static bool add_variable(block *b, const char *name, const lg_port *like, causality kind, size_t *at) {
    if (b->count + 1 >= MOST_PORTS) return false;
    variable *v = &b->variables[b->count];
    *v = (variable){.at = b->numbers, .count = like != NULL ? lg_shape_count(like->shape) : 1, .kind = kind};
    v->unit = like != NULL && like->unit != NULL && like->unit[0] != '\0' ? like->unit : NULL;
    (void)snprintf(v->name, sizeof v->name, "%s", name);
    b->numbers += v->count;
    *at = b->count++;
    return true;
}

/* Finds the variable of a function's input: an earlier variable with this name, or a new one. Returns false
 * if the earlier one has another size, or if there are too many variables. Only FMUs have parameters. */
static bool add_input(block *b, const lg_port *port, size_t *at) {
    for (size_t i = 0; i < b->count; i++) {
        const variable *v = &b->variables[i];
        if (v->kind != OUTPUT && v->kind != DERIVATIVE && strcmp(v->name, port->name) == 0) {
            *at = i;
            return v->count == lg_shape_count(port->shape);
        }
    }
    return add_variable(b, port->name, port, port->shared && b->derivatives ? PARAMETER : INPUT, at);
}

static void add_derivatives(block *b, part *p) {
    (void)export_add_name(&b->list, b->program, p->name);
    if (!b->derivatives) return;
    p->forward = export_derive(b->self, b->program, LG_DERIVATIVE_FORWARD, p->name);
    p->adjoint = export_derive(b->self, b->program, LG_DERIVATIVE_ADJOINT, p->name);
    if (p->forward != NULL) (void)export_add_name(&b->list, b->program, p->forward);
    if (p->adjoint != NULL) (void)export_add_name(&b->list, b->program, p->adjoint);
}

/* Adds the rate. The state and its derivative are always the first two variables. */
static bool add_rate(block *b, const char *function) {
    const export_ports f = export_ports_of(b->program, function);
    part *p = &b->parts[b->part_count++];
    char name[160];
    *p = (part){.name = function, .ins = f.ins, .outs = 1};
    bool fits = add_variable(b, f.in[0].name, &f.in[0], STATE, &p->in[0]);
    (void)snprintf(name, sizeof name, "der(%s)", f.in[0].name);
    fits = fits && add_variable(b, name, &f.in[0], DERIVATIVE, &p->out[0]);
    for (size_t i = 1; i < f.ins && fits; i++) fits = add_input(b, &f.in[i], &p->in[i]);
    b->variables[p->out[0]].unit = f.out[0].unit;
    b->states = b->variables[0].count;
    b->rate = true;
    if (fits) add_derivatives(b, p);
    return fits;
}

/* Adds a function and its outputs. Returns false if there are too many variables, or if one name has two
 * sizes. */
static bool add_outputs(block *b, const char *function) {
    const export_ports f = export_ports_of(b->program, function);
    part *p = &b->parts[b->part_count++];
    bool fits = f.ins <= MOST_PORTS && f.outs <= MOST_PORTS;
    *p = (part){.name = function, .ins = f.ins, .outs = f.outs};
    for (size_t i = 0; i < f.ins && fits; i++) fits = add_input(b, &f.in[i], &p->in[i]);
    for (size_t o = 0; o < f.outs && fits; o++) {
        char name[160];
        (void)snprintf(name, sizeof name, f.outs == 1 ? "%s" : "%s.%s", function, f.out[o].name);
        fits = add_variable(b, name, &f.out[o], OUTPUT, &p->out[o]);
    }
    if (fits) add_derivatives(b, p);
    return fits;
}

/* ---- choosing functions ---- */

/* Returns whether the function computes x' from x and inputs: it has one result, as long as the first
 * input. */
static bool is_rate(const block *b, const char *function) {
    const export_ports f = export_ports_of(b->program, function);
    return f.ins >= 1 && f.outs == 1 && !f.in[0].shared && !f.out[0].shared &&
           lg_shape_count(f.in[0].shape) == lg_shape_count(f.out[0].shape);
}

/* Returns whether the program has a `step` that takes the inputs of the rate and then h. */
static bool fits_step(const block *b) {
    const export_ports f = export_ports_of(b->program, "step");
    const part *rate = &b->parts[0];
    bool fits = f.ins == rate->ins + 1 && f.outs == 1 && lg_shape_count(f.in[f.ins - 1].shape) == 1;
    for (size_t i = 0; i + 1 < f.ins && fits; i++)
        fits = strcmp(f.in[i].name, b->variables[rate->in[i]].name) == 0;
    return fits;
}

/* Returns whether a function is an output by default. If the block has a rate, functions with other inputs
 * than the block's variables, or with an output that all rows of a batch share, are outputs only when
 * --functions names them. */
static bool is_usual(const block *b, const char *function) {
    const export_ports f = export_ports_of(b->program, function);
    bool usual = true;
    for (size_t o = 0; o < f.outs; o++) usual = usual && !f.out[o].shared;
    for (size_t i = 0; i < f.ins; i++) {
        bool known = false;
        for (size_t k = 0; k < b->count; k++)
            known = known || strcmp(b->variables[k].name, f.in[i].name) == 0;
        usual = usual && known;
    }
    return usual || !b->rate || b->source->options->functions != NULL;
}

/* Returns whether a function can be an output. In a block with a rate, the rate, its parts and `step`
 * cannot. */
static bool is_output(const char *function, const char *rate) {
    static const char *const parts[] = {"step",  "grad",  "field",   "velocity",
                                        "force", "drift", "momenta", NULL};
    for (size_t i = 0; rate != NULL && parts[i] != NULL; i++)
        if (strcmp(parts[i], function) == 0) return false;
    return rate == NULL || strcmp(rate, function) != 0;
}

/* Checks that what was added fits into the block. */
static void must_fit(const block *b, bool fits) {
    if (!fits)
        app_stop_usage(b->self,
                       "the functions do not fit into one block: a block has at most %d variables, and "
                       "inputs of the same name must have the same size; choose with --functions",
                       MOST_PORTS);
}

/* Adds a function as an output if its shapes allow this. Rejects a function of --functions that only the rate
 * calls. */
static void take_function(block *b, const char *function, const char *rate) {
    const bool output = is_output(function, rate), given = b->source->options->functions != NULL;
    if (!output && given && strcmp(function, rate) != 0 && strcmp(function, "step") != 0)
        app_stop_usage(b->self, "--functions: %s is a part of the rate %s, not an output of a block",
                       function, rate);
    if (!output || !is_usual(b, function)) return;
    if (b->part_count == MOST_FUNCTIONS)
        app_stop_usage(b->self, "a block has at most %d functions; choose with --functions", MOST_FUNCTIONS);
    must_fit(b, add_outputs(b, function));
}

void block_collect(block *b, bool derivatives) {
    static const char *const rates[] = {"velocity", "field", "rate", NULL};
    static const char *const usual[] = {"value", "positions", "velocities", NULL};
    const char *rate = NULL;
    size_t at;
    b->derivatives = derivatives;
    for (size_t i = 0; rates[i] != NULL && rate == NULL && !b->source->maps; i++)
        if (is_rate(b, rates[i])) rate = rates[i];
    must_fit(b, rate == NULL || add_rate(b, rate));
    export_names chosen;
    export_choose(b->self, b->source->options, b->program, usual, &chosen);
    for (size_t i = 0; i < chosen.count; i++) take_function(b, chosen.name[i], rate);
    must_fit(b, add_variable(b, "longest_step", NULL, PARAMETER, &at));
    b->step = b->rate && fits_step(b);
    if (b->step) (void)export_add_name(&b->list, b->program, "step");
}

/* ---- C code ---- */

static void add_call(const block *b, const char *function, text *to) {
    lg_text_add(to, "    %s_%s%s(", b->source->options->name, b->source->prefix, function);
}

static void add_arguments(const block *b, const char *array, const size_t *variables, size_t count,
                          text *to) {
    for (size_t i = 0; i < count; i++) lg_text_add(to, "%s + %zu, ", array, b->variables[variables[i]].at);
}

/* Calls a function of part p, whose results `out` go to, or a derivative of it. NULL: it has no such
 * argument. */
static void add_part(const block *b, const part *p, const char *function, const char *seed, const char *out,
                     const char *room, text *to) {
    add_call(b, function, to);
    add_arguments(b, "r", p->in, p->ins, to);
    if (seed != NULL) add_arguments(b, seed, p->in, p->ins, to);
    add_arguments(b, out, p->out, p->outs, to);
    if (room != NULL) add_arguments(b, room, p->in, p->ins, to);
    lg_text_add(to, "work);\n");
}

void block_add_evaluate(const block *b, text *to) {
    lg_text_add(to, "static void evaluate(const double *r, double *out, double *work) {\n");
    for (const part *p = b->parts; p < b->parts + b->part_count; p++)
        add_part(b, p, p->name, NULL, "out", NULL, to);
    lg_text_add(to, "}\n\n");
}

bool block_has(const block *b, bool forward) {
    bool all = true;
    for (size_t i = 0; i < b->part_count; i++)
        all = all && (forward ? b->parts[i].forward : b->parts[i].adjoint) != NULL;
    return all;
}

void block_add_forward(const block *b, text *to) {
    const bool can = block_has(b, true);
    lg_text_add(to, "/* Changes of derivatives and outputs with those of the other values, `seed`. */\n"
                    "static int forward(const double *r, const double *seed, double *out, double *work) {\n"
                    "    memcpy(out, seed, NUMBERS * sizeof *out);\n");
    if (!can) lg_text_add(to, "    (void)r, (void)work;\n");
    for (const part *p = b->parts; p < b->parts + b->part_count && can; p++)
        add_part(b, p, p->forward, "seed", "out", NULL, to);
    lg_text_add(to, "    return %d;\n}\n\n", can);
}

void block_add_adjoint(const block *b, text *to) {
    const bool can = block_has(b, false);
    lg_text_add(
        to,
        "static void add(double *to, const double *from, int count) {\n    int k;\n"
        "    for (k = 0; k < count; k++) to[k] += from[k];\n}\n\n"
        "/* Cotangents `seed` of derivatives and outputs, pulled back to the other values. Values that are "
        "results\n"
        " * themselves keep their own. */\n"
        "static int adjoint(const double *r, const double *seed, double *out, double *room, double *work) "
        "{\n    memcpy(out, seed, NUMBERS * sizeof *out);\n");
    if (!can) lg_text_add(to, "    (void)r, (void)room, (void)work, (void)add;\n");
    for (const part *p = b->parts; p < b->parts + b->part_count && can; p++) {
        add_part(b, p, p->adjoint, NULL, "seed", "room", to);
        for (size_t k = 0; k < p->ins; k++) {
            const variable *v = &b->variables[p->in[k]];
            lg_text_add(to, "    add(out + %zu, room + %zu, %zu);\n", v->at, v->at, v->count);
        }
    }
    lg_text_add(to, "    return %d;\n}\n\n", can);
}

void block_add_step(const block *b, text *to) {
    const part *rate = &b->parts[0];
    if (!b->rate) return;
    lg_text_add(to, "static void take_step(const double *r, double h, double *next, double *work) {\n");
    if (b->step) {
        add_call(b, "step", to);
        add_arguments(b, "r", rate->in, rate->ins, to);
        lg_text_add(to, "&h, next, work);\n}\n\n");
        return;
    }
    lg_text_add(to, "    static const double place[4] = {0, 0.5, 0.5, 1}, share[4] = {1, 2, 2, 1};\n"
                    "    double k[STATES], y[STATES];\n    int i, s;\n    memset(k, 0, sizeof k);\n"
                    "    memcpy(next, r, STATES * sizeof *next);\n    for (s = 0; s < 4; s++) {\n"
                    "        for (i = 0; i < STATES; i++) y[i] = r[i] + place[s] * h * k[i];\n    ");
    add_call(b, rate->name, to);
    lg_text_add(to, "y, ");
    add_arguments(b, "r", rate->in + 1, rate->ins - 1, to);
    lg_text_add(
        to,
        "k, work);\n        for (i = 0; i < STATES; i++) next[i] += share[s] * h / 6 * k[i];\n    }\n}\n\n");
}

double block_start(const block *b, size_t variable_at, size_t k) {
    const export_source *source = b->source;
    const variable *v = &b->variables[variable_at];
    const bool shared = v->kind == PARAMETER && variable_at + 1 < b->count;
    /* Each tunable parameter is one number; the first two variables are x and x'. */
    if (shared && b->rate && source->tunable > 0) return source->start[source->starts + variable_at - 2];
    if (v->kind == PARAMETER && !shared) return source->step > 0 ? source->step : 0.01;
    if (variable_at == 0 && source->starts == v->count) return source->start[k];
    return 0.0;
}

#define CAUSALITY_TEXT(name) "CAUSALITY_" #name,
static const char *const causalities[CAUSALITIES] = {CAUSALITY_LIST(CAUSALITY_TEXT)};

static void add_ports(const block *b, text *to) {
    lg_text_add(to, "enum { ");
    for (size_t k = 0; k < CAUSALITIES; k++) lg_text_add(to, "%s%s", k > 0 ? ", " : "", causalities[k]);
    lg_text_add(to, " };\n/* Variables: place in the array, count, causality. */\n"
                    "static const struct {\n    int at, count, causality;\n} ports[PORTS] = {\n");
    for (size_t i = 0; i < b->count; i++) {
        const variable *v = &b->variables[i];
        lg_text_add(to, "    {%zu, %zu, %s}, /* %s */\n", v->at, v->count, causalities[v->kind], v->name);
    }
    lg_text_add(to, "};\n");
}

void block_add_tables(const block *b, text *to) {
    lg_text_add(to, "enum { STATES = %zu, PORTS = %zu, NUMBERS = %zu, WORK = %s_WORK_SIZE };\n", b->states,
                b->count, b->numbers, b->source->options->name);
    add_ports(b, to);
    lg_text_add(to, "static const double start_values[NUMBERS] = {\n");
    for (size_t i = 0; i < b->count; i++) {
        for (size_t k = 0; k < b->variables[i].count; k++) {
            lg_text_add(to, "%s", k == 0 ? "    " : " ");
            lg_text_add_real(to, LG_F64, block_start(b, i, k));
            lg_text_add(to, ",");
        }
        lg_text_add(to, "\n");
    }
    lg_text_add(to, "};\n\n");
}
