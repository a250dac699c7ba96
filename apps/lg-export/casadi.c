/* CasADi externals: each function of a program, with its derivatives under the names that CasADi looks for
 * (casadi/core/external.cpp): f, jac_f, adj1_f, jac_adj1_f and fwd1_f, each with the symbols _n_in, _name_in,
 * _sparsity_in, _work and so on. Arguments and results are columns in the library's order (rows of matrices
 * one behind the other). Blocks of Jacobians are sparse if the program's sparsity says so. */
#include "lg-export/export.h"

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
    const char *function;
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

static int port_named(const lg_port *list, size_t count, const char *name) {
    for (size_t i = 0; i < count; i++)
        if (strcmp(list[i].name, name) == 0) return (int)i;
    return -1;
}

/* Columns of the inputs or of the outputs of a function, with a beginning for their names. */
typedef struct group {
    const char *begin;
    bool outputs;
} group;

/* Adds a slot for each column of a group. If the entry's function has no port of its name, the slot is
 * empty. */
static void add_columns(slot *slots, size_t *count, const group *g, const export_ports *f, const lg_port *own,
                        size_t own_count) {
    for (size_t i = 0; i < (g->outputs ? f->outs : f->ins); i++) {
        const lg_port *like = g->outputs ? &f->out[i] : &f->in[i];
        slot *s = &slots[(*count)++];
        *s = (slot){.rows = lg_shape_count(like->shape), .columns = 1};
        (void)snprintf(s->name, sizeof s->name, "%s%s", g->begin, like->name);
        s->port = port_named(own, own_count, s->name);
    }
}

/* Which elements of the output depend on which elements of the input, (rows, columns); NULL: dense. */
static unsigned char *pattern_of(const job *j, const char *function, const char *output, const char *input,
                                 size_t size) {
    size_t at = 0;
    (void)lg_program_find(j->program, function, &at, NULL);
    const export_ports f = export_ports_of(j->program, function);
    const int i = port_named(f.in, f.ins, input), o = port_named(f.out, f.outs, output);
    if (i < 0 || o < 0) return NULL;
    unsigned char *pattern = app_keep(size, 1);
    const lg_status status = lg_program_sparsity(j->program, at, (size_t)o, (size_t)i, pattern, NULL);
    return status != LG_OK || memchr(pattern, 0, size) == NULL ? NULL : pattern;
}

/* Replaces the results of the entry by the blocks of their Jacobian by the first arguments (`by`), in which
 * arguments are the inner loop. */
static void add_blocks(const job *j, entry *e, const char *of, size_t by, slot *block) {
    const export_ports own = export_ports_of(j->program, e->function);
    for (size_t k = 0; k < e->outs * by; k++) {
        const slot *out = &e->out[k / by], *in = &e->in[k % by];
        slot *s = &block[k];
        *s = (slot){.rows = out->rows, .columns = in->rows};
        (void)lg_format(s->name, sizeof s->name, "jac_%s_%s", out->name, in->name);
        s->port = port_named(own.out, own.outs, s->name);
        if (s->port >= 0) s->pattern = pattern_of(j, of, out->name, in->name, s->rows * s->columns);
    }
    e->out = block;
    e->outs *= by;
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
    const export_ports f = export_ports_of(j->program, e->function);
    lg_text_add(
        j->to,
        "static void call_%zu(const casadi_real *const *x, casadi_real *const *y, casadi_real *work) {\n"
        "    %s_%s%s(",
        j->entries, j->source->options->name, j->source->prefix, e->function);
    for (size_t i = 0; i < f.ins; i++) lg_text_add(j->to, "x[%zu], ", i);
    for (size_t o = 0; o < f.outs; o++) lg_text_add(j->to, "y[%zu], ", o);
    lg_text_add(j->to, "work);\n}\n");
    if (f.ins > j->most_in) j->most_in = f.ins;
    if (f.outs > j->most_out) j->most_out = f.outs;
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

enum { FORWARD, ADJOINT, JACOBIAN, SECOND, DERIVATIVES };

/* The entries of a function: itself, and its derivatives. The arguments are the columns of groups. The
 * results are columns, or the blocks of their Jacobian by the arguments in the first `by` groups. */
typedef struct form {
    const char *begin; /* of the symbol; the model's name and the function's name follow */
    int derivative;    /* -1: the function itself */
    size_t ins, by;
    group in[4], out;
} form;
static const form forms[] = {
    {"", -1, 1, 0, {{"", false}}, {"", true}},
    {"jac_", JACOBIAN, 2, 1, {{"", false}, {"out_", true}}, {"", true}},
    {"fwd1_", FORWARD, 3, 0, {{"", false}, {"out_", true}, {"fwd_", false}}, {"fwd_", true}},
    {"adj1_", ADJOINT, 3, 0, {{"", false}, {"out_", true}, {"adj_", true}}, {"adj_", false}},
    {"jac_adj1_",
     SECOND,
     4,
     3,
     {{"", false}, {"out_", true}, {"adj_", true}, {"out_adj_", false}},
     {"adj_", false}}};

/* `of`: the function whose Jacobian the blocks are. */
static void write_form(job *j, const form *how, const char *function, const char *own, const char *of) {
    const export_ports f = export_ports_of(j->program, function), d = export_ports_of(j->program, own);
    APP_FREE char *symbol = app_format("%s%s_%s", how->begin, j->source->options->name, function);
    APP_FREE slot *in = app_alloc(2 * (f.ins + f.outs), sizeof *in),
                  *result = app_alloc(f.ins + f.outs, sizeof *in);
    entry e = {.function = own, .in = in, .out = result};
    size_t results = 0, by = 0;
    for (size_t g = 0; g < how->ins; g++) {
        add_columns(e.in, &e.ins, &how->in[g], &f, d.in, d.ins);
        if (g + 1 == how->by) by = e.ins;
    }
    add_columns(result, &results, &how->out, &f, d.out, d.outs);
    APP_FREE slot *block = app_alloc(results * by, sizeof *block);
    e.outs = results;
    if (by > 0) add_blocks(j, &e, of, by, block);
    write_entry(j, symbol, &e);
}

static bool has_shared(const export_ports *p) {
    bool any = false;
    for (size_t i = 0; i < p->ins; i++) any = any || p->in[i].shared;
    for (size_t i = 0; i < p->outs; i++) any = any || p->out[i].shared;
    return any;
}

/* Adds the function's derivatives to the program, and the names of the function and of its derivatives to
 * `list`. A second derivative needs the adjoint. */
static void derive(job *j, const char *function, const char *derived[DERIVATIVES], export_names *list) {
    static const lg_derivative_kind kinds[DERIVATIVES] = {[FORWARD] = LG_DERIVATIVE_FORWARD,
                                                          [ADJOINT] = LG_DERIVATIVE_ADJOINT,
                                                          [JACOBIAN] = LG_DERIVATIVE_JACOBIAN,
                                                          [SECOND] = LG_DERIVATIVE_JACOBIAN_OF_ADJOINT};
    const export_ports f = export_ports_of(j->program, function);
    const bool shared = has_shared(&f), large = export_numbers(f.in, f.ins) > MOST_SECOND;
    (void)export_add_name(list, j->program, function);
    if (shared)
        app_warn(j->self, "%s has a port that all rows of a batch share: it is exported without derivatives",
                 function);
    else if (large)
        app_warn(j->self, "%s has %zu inputs: it is exported without second derivatives", function,
                 export_numbers(f.in, f.ins));
    for (size_t k = 0; k < DERIVATIVES; k++) {
        const bool possible = !shared && !(k == SECOND && (large || derived[ADJOINT] == NULL));
        derived[k] = possible ? export_derive(j->self, j->program, kinds[k], function) : NULL;
        if (derived[k] != NULL) (void)export_add_name(list, j->program, derived[k]);
    }
}

static void write_function(job *j, const char *function, const char *derived[DERIVATIVES]) {
    for (const form *f = forms; f < forms + LG_COUNT(forms); f++) {
        const char *own = f->derivative < 0 ? function : derived[f->derivative];
        if (own != NULL) write_form(j, f, function, own, f->by > 1 ? derived[ADJOINT] : function);
    }
}

/* ---- the file ---- */

/* Writes the file. The tables are first collected in `body`: the file begins with sizes (MOST_INPUTS, ...)
 * that are known only after the tables are made. */
static void write_file(job *j, const export_names *functions, const char *(*derived)[DERIVATIVES]) {
    const char *name = j->source->options->name;
    text body = app_text(), *to = export_add_file(j->source, "%s_casadi.c");
    j->to = &body;
    for (size_t i = 0; i < functions->count; i++) write_function(j, functions->name[i], derived[i]);
    lg_text_add(to, "/* Functions of %s.h for CasADi:\n *  ", name);
    lg_text_add(to, "%s.\n", j->symbols.data);
    lg_text_add(
        to,
        " * casadi.external(\"%s_%s\", \"./lib%s.so\") loads one with its derivatives. Arguments and "
        "results are\n * columns; rows of matrices stand one behind the other. Written by lg-export.\n",
        name, functions->name[0], name);
    export_add_words(j->source, to);
    lg_text_add(to, " */\n#include <stddef.h>\n\n#include \"%s.h\"\n\n", name);
    lg_text_add(to,
                "enum { MOST_INPUTS = %zu, MOST_OUTPUTS = %zu };\nstatic const double zeros[%zu] = {0};\n\n",
                j->most_in, j->most_out, j->most_zeros);
    lg_text_add_named(to, name, export_fragment_text("casadi_run"));
    lg_text_add(to, "%s%s", j->has_zeros ? "\nstatic const int no_nonzeros[] = {0};\n" : "", body.data);
    lg_text_destroy(&body);
}

static void build(const app *self, const char *path, lg_program *program, export_source *source) {
    static const char *const usual[] = {"value", "field", "velocity", "step", NULL};
    job j = {.self = self, .program = program, .source = source, .symbols = app_text()};
    export_names functions, list = {.count = 0};
    const char *derived[LG_PROGRAM_MAX_FUNCTIONS][DERIVATIVES];
    export_choose(self, source->options, program, usual, &functions);
    for (size_t i = 0; i < functions.count; i++) derive(&j, functions.name[i], derived[i], &list);
    source->prefix = "c_";
    export_whole(self, path, program, &list, source);
    export_add_rules(source, "libNAME_.so", export_fragment_text("casadi.gmake"));
    export_compose(source);
    write_file(&j, &functions, derived);
    lg_text_destroy(&j.symbols);
}

const export_target export_target_casadi = {.build = build, .wide = "CasADi computes"};
