/* CasADi externals: each function of a program, with its derivatives under the names that CasADi looks for
 * (casadi/core/external.cpp): f, jac_f, adj1_f, jac_adj1_f and fwd1_f, each with the symbols _n_in, _name_in,
 * _sparsity_in, _work and so on. Arguments and results are columns in the library's order (rows of matrices
 * one behind the other). Blocks of Jacobians are sparse if the program's sparsity says so. */
#include "lg-export/export.h"

#include <stdlib.h>
#include <string.h>

/* Functions with more input numbers get no second derivative. */
enum { MOST_SECOND = 512 };

/* An argument or result, in the order of CasADi. */
typedef struct slot {
    char name[256];
    size_t rows, columns;
    /* Index of the port of the program's function; -1: the function has no such port, and the slot has no
     * nonzeros. */
    int port;
    const unsigned char *pattern; /* (rows, columns); NULL: dense, or a slot without a port. */
} slot;

/* A function of the program that gets symbols, with its arguments and results. */
typedef struct entry {
    char *function;
    slot *in, *out;
    size_t ins, outs;
} entry;

typedef struct job {
    const app *self;
    lg_program *program;
    export_source *source;
    text *to;
    bool has_zeros; /* Some block has a port but no nonzeros. */
    size_t entries, tables, most_in, most_out, most_zeros;
    text symbols;
} job;

/* ---- arguments and results ---- */

static int port_named(const lg_port *ports, size_t count, const char *name) {
    for (size_t i = 0; i < count; i++)
        if (strcmp(ports[i].name, name) == 0) return (int)i;
    return -1;
}

/* Adds a slot for a column of the port's numbers. If the function has no port of this name, the slot is
 * empty. */
static void add_column(slot *slots, size_t *count, const char *begin, const lg_port *like,
                       const lg_port *ports, size_t port_count) {
    slot *s = &slots[(*count)++];
    *s = (slot){.rows = lg_shape_count(like->shape), .columns = 1};
    (void)snprintf(s->name, sizeof s->name, "%s%s", begin, like->name);
    s->port = port_named(ports, port_count, s->name);
}

static void add_columns(slot *slots, size_t *count, const char *begin, const lg_port *like, size_t like_count,
                        const lg_port *ports, size_t port_count) {
    for (size_t i = 0; i < like_count; i++) add_column(slots, count, begin, &like[i], ports, port_count);
}

/* Returns which elements of the output depend on which elements of the input, (rows, columns); NULL: dense.
 * Freed with the entry. */
static unsigned char *pattern_of(const job *j, const char *function, const char *output, const char *input,
                                 size_t size) {
    size_t ins, outs;
    size_t at = 0;
    (void)lg_program_find(j->program, function, &at, NULL);
    const lg_port *in = export_ports(j->program, function, false, &ins),
                  *out = export_ports(j->program, function, true, &outs);
    const int i = port_named(in, ins, input), o = port_named(out, outs, output);
    if (i < 0 || o < 0) return NULL;
    unsigned char *pattern = app_alloc(size, 1);
    const lg_status status = lg_program_sparsity(j->program, at, (size_t)o, (size_t)i, pattern, NULL);
    bool dense = status != LG_OK || memchr(pattern, 0, size) == NULL;
    if (!dense) return pattern;
    free(pattern);
    return NULL;
}

/* Adds the blocks of the Jacobian of `of`: outputs in the outer loop, arguments in the inner loop. */
static void add_blocks(const job *j, entry *e, const char *of, const slot *out, size_t outs, const slot *in,
                       size_t ins) {
    size_t count;
    const lg_port *ports = export_ports(j->program, e->function, true, &count);
    for (size_t o = 0; o < outs; o++)
        for (size_t i = 0; i < ins; i++) {
            slot *s = &e->out[e->outs++];
            *s = (slot){.rows = out[o].rows, .columns = in[i].rows};
            (void)snprintf(s->name, sizeof s->name, "jac_%s_%s", out[o].name, in[i].name);
            s->port = port_named(ports, count, s->name);
            if (s->port >= 0) s->pattern = pattern_of(j, of, out[o].name, in[i].name, s->rows * s->columns);
        }
}

/* ---- tables ---- */

static bool is_empty(const slot *s) {
    return s->port < 0;
}

/* Writes {rows, columns, 1} for a dense slot, otherwise its compressed columns and then the places of the
 * nonzeros in the dense row-major matrix. */
static void write_sparsity(job *j, const slot *s, size_t table) {
    text *to = j->to;
    lg_text_add(to, "static const casadi_int sparsity_%zu[] = {%zu, %zu", table, s->rows, s->columns);
    if (!is_empty(s) && s->pattern == NULL) {
        lg_text_add(to, ", 1};\n");
        return;
    }
    size_t count = 0;
    lg_text_add(to, ", 0");
    for (size_t c = 0; c < s->columns; c++) {
        for (size_t r = 0; r < s->rows && !is_empty(s); r++) count += s->pattern[r * s->columns + c];
        lg_text_add(to, ", %zu", count);
    }
    for (size_t c = 0; c < s->columns && !is_empty(s); c++)
        for (size_t r = 0; r < s->rows; r++)
            if (s->pattern[r * s->columns + c]) lg_text_add(to, ",%s%zu", r % 32 == 31 ? "\n    " : " ", r);
    lg_text_add(to, "};\n");
    if (count == 0) return;
    lg_text_add(to, "static const int nonzeros_%zu[] = {", table);
    const char *comma = "";
    for (size_t c = 0; c < s->columns; c++)
        for (size_t r = 0; r < s->rows; r++)
            if (s->pattern[r * s->columns + c]) {
                lg_text_add(to, "%s%zu", comma, r * s->columns + c);
                comma = r % 24 == 23 ? ",\n    " : ", ";
            }
    lg_text_add(to, "};\n");
}

static size_t nonzeros_of(const slot *s) {
    size_t count = 0;
    for (size_t i = 0; s->pattern != NULL && i < s->rows * s->columns; i++) count += s->pattern[i];
    return count;
}

static void write_slots(job *j, const char *what, const slot *slots, size_t count) {
    const size_t first = j->tables;
    for (size_t i = 0; i < count; i++) write_sparsity(j, &slots[i], j->tables++);
    lg_text_add(j->to, "static const slot %s_%zu[] = {\n", what, j->entries);
    for (size_t i = 0; i < count; i++) {
        const slot *s = &slots[i];
        const size_t nonzeros = nonzeros_of(s);
        /* If a pattern has no nonzeros, nothing is copied to CasADi's result, but the exported function still
         * computes the dense block. */
        lg_text_add(j->to, "    {\"%s\", sparsity_%zu, %d, ", s->name, first + i, s->port);
        if (nonzeros > 0)
            lg_text_add(j->to, "nonzeros_%zu, %zu},\n", first + i, nonzeros);
        else
            lg_text_add(j->to, "%s, 0},\n", s->pattern != NULL ? "no_nonzeros" : "NULL");
        j->has_zeros = j->has_zeros || (nonzeros == 0 && s->pattern != NULL);
    }
    lg_text_add(j->to, "};\n");
}

/* Writes call_<n>, which passes arguments and results to the function of the exported code. */
static void write_call(job *j, const entry *e) {
    size_t ins, outs;
    (void)export_ports(j->program, e->function, false, &ins);
    (void)export_ports(j->program, e->function, true, &outs);
    lg_text_add(
        j->to,
        "static void call_%zu(const casadi_real *const *x, casadi_real *const *y, casadi_real *work) {\n"
        "    %s_%s%s(",
        j->entries, j->source->options->name, j->source->prefix, e->function);
    for (size_t i = 0; i < ins; i++) lg_text_add(j->to, "x[%zu], ", i);
    for (size_t o = 0; o < outs; o++) lg_text_add(j->to, "y[%zu], ", o);
    lg_text_add(j->to, "work);\n}\n");
    if (ins > j->most_in) j->most_in = ins;
    if (outs > j->most_out) j->most_out = outs;
}

static void write_entry(job *j, const char *symbol, const entry *e) {
    size_t room = 0;
    lg_text_add(j->to, "\n/* ---- %s ---- */\n\n", symbol);
    write_slots(j, "in", e->in, e->ins);
    write_slots(j, "out", e->out, e->outs);
    write_call(j, e);
    for (size_t o = 0; o < e->outs; o++)
        if (e->out[o].port >= 0 &&
            (e->out[o].pattern != NULL || (e->out[o].rows > 1 && e->out[o].columns > 1)))
            room += e->out[o].rows * e->out[o].columns;
    for (size_t i = 0; i < e->ins; i++)
        if (e->in[i].rows > j->most_zeros) j->most_zeros = e->in[i].rows;
    lg_text_add(j->to,
                "static const function function_%zu = {call_%zu, in_%zu, out_%zu, %zu, %zu, "
                "%s_%s%s_WORK_SIZE + %zu};\nEXTERNAL(%s, function_%zu)\n",
                j->entries, j->entries, j->entries, j->entries, e->ins, e->outs, j->source->options->name,
                j->source->prefix, e->function, room, symbol, j->entries);
    lg_text_add(&j->symbols, "%s %s", j->symbols.length > 0 ? "," : "", symbol);
    j->entries++;
}

/* ---- a function and its derivatives ---- */

typedef struct ports {
    const lg_port *in, *out;
    size_t ins, outs;
} ports;

static ports ports_of(const job *j, const char *function) {
    ports p;
    p.in = export_ports(j->program, function, false, &p.ins);
    p.out = export_ports(j->program, function, true, &p.outs);
    return p;
}

/* Writes the entry of a function or derivative, whose symbol is `begin` ("", "jac_", ...), then the model's
 * name, then the function's name; frees the entry's lists. */
static void end_entry(job *j, const char *begin, const char *function, entry *e) {
    APP_FREE char *symbol = app_format("%s%s_%s", begin, j->source->options->name, function);
    write_entry(j, symbol, e);
    for (size_t o = 0; o < e->outs; o++) free((void *)e->out[o].pattern);
    free(e->out);
    free(e->in);
}

/* The arguments (x, out_y) of a derivative. */
static void add_given(entry *e, const ports *f, const ports *d) {
    add_columns(e->in, &e->ins, "", f->in, f->ins, d->in, d->ins);
    add_columns(e->in, &e->ins, "out_", f->out, f->outs, d->in, d->ins);
}

static void write_value(job *j, char *function) {
    const ports f = ports_of(j, function);
    entry e = {.function = function};
    e.in = app_alloc(f.ins, sizeof *e.in);
    e.out = app_alloc(f.outs, sizeof *e.out);
    add_columns(e.in, &e.ins, "", f.in, f.ins, f.in, f.ins);
    add_columns(e.out, &e.outs, "", f.out, f.outs, f.out, f.outs);
    end_entry(j, "", function, &e);
}

/* Writes the Jacobian: arguments (x, out_y), results jac_y_x. */
static void write_jacobian(job *j, char *function, char *derived) {
    const ports f = ports_of(j, function), d = ports_of(j, derived);
    entry e = {.function = derived}, value = {.function = function};
    size_t count = 0;
    e.in = app_alloc(f.ins + f.outs, sizeof *e.in);
    e.out = app_alloc(f.ins * f.outs, sizeof *e.out);
    value.out = app_alloc(f.outs, sizeof *value.out);
    add_given(&e, &f, &d);
    add_columns(value.out, &count, "", f.out, f.outs, f.out, f.outs);
    add_blocks(j, &e, function, value.out, f.outs, e.in, f.ins);
    end_entry(j, "jac_", function, &e);
    free(value.out);
}

/* Writes the forward derivative, with arguments (x, out_y, fwd_x) and results fwd_y; or, if not `forward`,
 * the adjoint derivative, with arguments (x, out_y, adj_y) and results adj_x. */
static void write_sensitivity(job *j, const char *begin, char *function, char *derived, bool forward) {
    const ports f = ports_of(j, function), d = ports_of(j, derived);
    const char *letters = forward ? "fwd_" : "adj_";
    entry e = {.function = derived};
    e.in = app_alloc(2 * f.ins + 2 * f.outs, sizeof *e.in);
    e.out = app_alloc(f.ins + f.outs, sizeof *e.out);
    add_given(&e, &f, &d);
    add_columns(e.in, &e.ins, letters, forward ? f.in : f.out, forward ? f.ins : f.outs, d.in, d.ins);
    add_columns(e.out, &e.outs, letters, forward ? f.out : f.in, forward ? f.outs : f.ins, d.out, d.outs);
    end_entry(j, begin, function, &e);
}

/* Writes the Jacobian of the adjoint derivative: arguments (x, out_y, adj_y, out_adj_x), results jac_adj_x_w
 * for each w of x, out_y, adj_y. */
static void write_second(job *j, char *function, char *adjoint, char *derived) {
    const ports f = ports_of(j, function), d = ports_of(j, derived);
    entry e = {.function = derived};
    size_t count = 0;
    APP_FREE slot *adjoints = app_alloc(f.ins, sizeof *adjoints);
    e.in = app_alloc(2 * f.ins + 2 * f.outs, sizeof *e.in);
    e.out = app_alloc(f.ins * (f.ins + 2 * f.outs), sizeof *e.out);
    add_given(&e, &f, &d);
    add_columns(e.in, &e.ins, "adj_", f.out, f.outs, d.in, d.ins);
    const size_t by = e.ins;
    add_columns(e.in, &e.ins, "out_adj_", f.in, f.ins, d.in, d.ins);
    add_columns(adjoints, &count, "adj_", f.in, f.ins, d.in, d.ins);
    add_blocks(j, &e, adjoint, adjoints, count, e.in, by);
    end_entry(j, "jac_adj1_", function, &e);
}

static size_t numbers_of(const lg_port *p, size_t count) {
    size_t sum = 0;
    for (size_t i = 0; i < count; i++) sum += lg_shape_count(p[i].shape);
    return sum;
}

static bool has_shared(const ports *p) {
    bool any = false;
    for (size_t i = 0; i < p->ins; i++) any = any || p->in[i].shared;
    for (size_t i = 0; i < p->outs; i++) any = any || p->out[i].shared;
    return any;
}

enum { FORWARD, ADJOINT, JACOBIAN, SECOND, DERIVATIVES };

/* Adds the function's derivatives to the program, and the names of the function and of its derivatives to
 * `list`. A second derivative needs the adjoint. */
static void derive(job *j, const char *function, char *derived[DERIVATIVES], text *list) {
    static const lg_derivative_kind kinds[DERIVATIVES] = {[FORWARD] = LG_DERIVATIVE_FORWARD,
                                                          [ADJOINT] = LG_DERIVATIVE_ADJOINT,
                                                          [JACOBIAN] = LG_DERIVATIVE_JACOBIAN,
                                                          [SECOND] = LG_DERIVATIVE_JACOBIAN_OF_ADJOINT};
    const ports f = ports_of(j, function);
    const bool shared = has_shared(&f), large = numbers_of(f.in, f.ins) > MOST_SECOND;
    lg_text_add(list, "%s%s", list->length > 0 ? "," : "", function);
    if (shared)
        app_warn(j->self, "%s has a port that all rows of a batch share: it is exported without derivatives",
                 function);
    else if (large)
        app_warn(j->self, "%s has %zu inputs: it is exported without second derivatives", function,
                 numbers_of(f.in, f.ins));
    for (size_t k = 0; k < DERIVATIVES; k++) {
        const bool possible = !shared && !(k == SECOND && (large || derived[ADJOINT] == NULL));
        derived[k] = possible ? export_derive(j->self, j->program, kinds[k], function) : NULL;
        if (derived[k] != NULL) lg_text_add(list, ",%s", derived[k]);
    }
}

static void write_function(job *j, char *function, char *derived[DERIVATIVES]) {
    write_value(j, function);
    if (derived[JACOBIAN] != NULL) write_jacobian(j, function, derived[JACOBIAN]);
    if (derived[FORWARD] != NULL) write_sensitivity(j, "fwd1_", function, derived[FORWARD], true);
    if (derived[ADJOINT] != NULL) write_sensitivity(j, "adj1_", function, derived[ADJOINT], false);
    if (derived[SECOND] != NULL) write_second(j, function, derived[ADJOINT], derived[SECOND]);
}

/* ---- the file ---- */

static const char rules[] =
    "# The library for casadi.external. CasADi's own integers are long long; for generated code of acados\n"
    "# make clean && make CASADI_INT=int.\n"
    "CASADI_INT ?= long long\n"
    "\n"
    "libNAME_.so: NAME_casadi.c NAME_.c NAME_weights.c NAME_.h\n"
    "\t$(CC) $(CFLAGS) -fPIC -shared '-Dcasadi_int=$(CASADI_INT)' NAME_casadi.c NAME_.c NAME_weights.c "
    "$(LDFLAGS) -lm -o libNAME_.so\n";

/* Writes the file. The tables are first collected in `body`: the file begins with sizes (MOST_INPUTS, ...)
 * that are known only after the tables are made. */
static void write_file(job *j, char **functions, char *(*derived)[DERIVATIVES], size_t count) {
    const char *name = j->source->options->name;
    text body = app_text(), *to = export_add_file(j->source, "%s_casadi.c");
    j->to = &body;
    for (size_t i = 0; i < count; i++) write_function(j, functions[i], derived[i]);
    lg_text_add(to, "/* Functions of %s.h for CasADi:\n *  ", name);
    lg_text_add(to, "%s.\n", j->symbols.data);
    lg_text_add(
        to,
        " * casadi.external(\"%s_%s\", \"./lib%s.so\") loads one with its derivatives. Arguments and "
        "results are\n * columns; rows of matrices stand one behind the other. Written by lg-export.\n",
        name, functions[0], name);
    export_add_words(j->source, to);
    lg_text_add(to, " */\n#include <stddef.h>\n\n#include \"%s.h\"\n\n", name);
    lg_text_add(to,
                "enum { MOST_INPUTS = %zu, MOST_OUTPUTS = %zu };\nstatic const double zeros[%zu] = {0};\n\n",
                j->most_in, j->most_out, j->most_zeros);
    lg_text_add_named(to, name, export_fragment_text("casadi_run"));
    lg_text_add(to, "%s%s", j->has_zeros ? "\nstatic const int no_nonzeros[] = {0};\n" : "", body.data);
    lg_text_destroy(&body);
}

static size_t split(char *list, char **names, size_t most) {
    size_t count = 0;
    for (char *save = NULL, *name = strtok_r(list, ",", &save); name != NULL && count < most;
         name = strtok_r(NULL, ",", &save))
        names[count++] = name;
    return count;
}

static void build(const app *self, const char *path, lg_program *program, export_source *source) {
    static const char *const usual[] = {"value", "field", "velocity", "step", NULL};
    const size_t most = lg_program_functions(program);
    job j = {.self = self, .program = program, .source = source, .symbols = app_text()};
    char *chosen = export_choose(self, source->options, program, usual);
    APP_FREE char **functions = app_alloc(most, sizeof *functions);
    char *(*derived)[DERIVATIVES] = app_alloc(most, sizeof *derived);
    const size_t count = split(chosen, functions, most);
    text list = app_text();
    for (size_t i = 0; i < count; i++) derive(&j, functions[i], derived[i], &list);
    source->prefix = "c_";
    export_whole(self, path, program, list.data, source);
    export_add_rules(source, "libNAME_.so", rules);
    export_compose(source);
    write_file(&j, functions, derived, count);
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < DERIVATIVES; k++) free(derived[i][k]);
    lg_text_destroy(&j.symbols);
    lg_text_destroy(&list);
    free(derived);
    free(chosen);
}

const export_target export_target_casadi = {.build = build, .wide = "CasADi computes"};
