/* FMUs: their description and functions, values and derivatives compared with the program. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "apps/random/fmu.h"
#include "liegrad/program.h"

/* ---- functions with other types in each version ---- */

typedef struct event_info {
    int flags[5];
    double next;
} event_info;

/* Declares `pointer`, the address of fmi<version><name>. */
#define SYMBOL(name, result, parameters, pointer)                                                            \
    result(*pointer) parameters;                                                                             \
    *(void **)&pointer = symbol_in(f->m, "fmi%d%s", f->version, name);                                       \
    if (pointer == NULL) stop("no symbol fmi%d%s", f->version, name)

void *fmu_instantiate(const fmu *f, bool exchange) {
    if (f->version == 2) {
        SYMBOL("Instantiate", void *, (const char *, int, const char *, const char *, const void *, int, int),
               two);
        return two("a", exchange ? 0 : 1, f->token, NULL, NULL, 0, 0);
    }
    if (exchange) {
        SYMBOL("InstantiateModelExchange", void *,
               (const char *, const char *, const char *, bool, bool, void *, void *), three);
        return three("a", f->token, NULL, false, false, NULL, NULL);
    }
    SYMBOL("InstantiateCoSimulation", void *,
           (const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t,
            void *, void *, void *),
           three);
    return three("a", f->token, NULL, false, false, false, false, NULL, 0, NULL, NULL, NULL);
}

void fmu_free(const fmu *f, void *c) {
    SYMBOL("FreeInstance", void, (void *), release);
    release(c);
}

int fmu_begin(const fmu *f, void *c, double time) {
    if (f->version == 3) {
        SYMBOL("EnterInitializationMode", int, (void *, bool, double, double, bool, double), three);
        return three(c, false, 0, time, false, 0);
    }
    SYMBOL("SetupExperiment", int, (void *, int, double, double, int, double), experiment);
    SYMBOL("EnterInitializationMode", int, (void *), two);
    const int status = experiment(c, 0, 0, time, 0, 0);
    return status != 0 ? status : two(c);
}

/* References of the chosen variables, and where their numbers lie. *numbers: how many numbers they have. */
static size_t list(const fmu *f, uint64_t set, unsigned *references, size_t *places, size_t *numbers) {
    size_t n = 0;
    *numbers = 0;
    for (size_t v = 0; v < f->count; v++) {
        if (!(set >> v & 1)) continue;
        if (f->version == 3) references[n++] = f->variables[v].reference;
        for (size_t k = 0; k < f->variables[v].count; k++) {
            if (f->version == 2) references[n++] = f->variables[v].reference + (unsigned)k;
            places[(*numbers)++] = f->variables[v].at + k;
        }
    }
    return n;
}

typedef struct selection {
    unsigned references[REFERENCES];
    size_t places[REFERENCES], n, count;
    double numbers[REFERENCES];
} selection;

static void pick(const fmu *f, uint64_t set, const double *from, selection *s) {
    s->n = list(f, set, s->references, s->places, &s->count);
    for (size_t i = 0; i < s->count; i++) s->numbers[i] = from != NULL ? from[s->places[i]] : NAN;
}

static void put(const selection *s, double *to) {
    for (size_t i = 0; i < s->count; i++) to[s->places[i]] = s->numbers[i];
}

int fmu_get(const fmu *f, void *c, uint64_t set, double *numbers) {
    selection s;
    int status;
    pick(f, set, NULL, &s);
    if (f->version == 2) {
        SYMBOL("GetReal", int, (void *, const unsigned *, size_t, double *), two);
        status = two(c, s.references, s.n, s.numbers);
    } else {
        SYMBOL("GetFloat64", int, (void *, const unsigned *, size_t, double *, size_t), three);
        status = three(c, s.references, s.n, s.numbers, s.count);
    }
    if (status == 0) put(&s, numbers);
    return status;
}

int fmu_set(const fmu *f, void *c, uint64_t set, const double *numbers) {
    selection s;
    pick(f, set, numbers, &s);
    if (f->version == 2) {
        SYMBOL("SetReal", int, (void *, const unsigned *, size_t, const double *), two);
        return two(c, s.references, s.n, s.numbers);
    }
    SYMBOL("SetFloat64", int, (void *, const unsigned *, size_t, const double *, size_t), three);
    return three(c, s.references, s.n, s.numbers, s.count);
}

int fmu_raw(const fmu *f, void *c, bool writes, size_t variable_at, bool none) {
    const bool is = variable_at != SIZE_MAX;
    const unsigned reference = is                ? f->variables[variable_at].reference
                               : f->version == 2 ? 1u << 20
                                                 : 1u << 10;
    const size_t count = is ? f->variables[variable_at].count : 1;
    double *numbers = room(count, sizeof *numbers), *given = none ? NULL : numbers;
    int status;
    if (f->version == 2) {
        SYMBOL(writes ? "SetReal" : "GetReal", int, (void *, const unsigned *, size_t, double *), two);
        status = two(c, &reference, 1, given);
    } else {
        SYMBOL(writes ? "SetFloat64" : "GetFloat64", int,
               (void *, const unsigned *, size_t, double *, size_t), three);
        status = three(c, &reference, 1, given, count);
    }
    free(numbers);
    return status;
}

int fmu_forward(const fmu *f, void *c, uint64_t unknown, uint64_t known, const double *seed, double *out) {
    selection u, k;
    int status;
    pick(f, unknown, NULL, &u);
    pick(f, known, seed, &k);
    if (f->version == 2) {
        SYMBOL("GetDirectionalDerivative", int,
               (void *, const unsigned *, size_t, const unsigned *, size_t, const double *, double *), two);
        status = two(c, u.references, u.n, k.references, k.n, k.numbers, u.numbers);
    } else {
        SYMBOL("GetDirectionalDerivative", int,
               (void *, const unsigned *, size_t, const unsigned *, size_t, const double *, size_t, double *,
                size_t),
               three);
        status = three(c, u.references, u.n, k.references, k.n, k.numbers, k.count, u.numbers, u.count);
    }
    if (status == 0) put(&u, out);
    return status;
}

int fmu_adjoint(const fmu *f, void *c, uint64_t unknown, uint64_t known, const double *seed, double *out) {
    selection u, k;
    pick(f, unknown, seed, &u);
    pick(f, known, NULL, &k);
    SYMBOL("GetAdjointDerivative", int,
           (void *, const unsigned *, size_t, const unsigned *, size_t, const double *, size_t, double *,
            size_t),
           three);
    const int status = three(c, u.references, u.n, k.references, k.n, u.numbers, u.count, k.numbers, k.count);
    if (status == 0) put(&k, out);
    return status;
}

int fmu_step(const fmu *f, void *c, double now, double length) {
    bool flags[3];
    double last;
    if (f->version == 2) {
        SYMBOL("DoStep", int, (void *, double, double, int), two);
        return two(c, now, length, 1);
    }
    SYMBOL("DoStep", int, (void *, double, double, bool, bool *, bool *, bool *, double *), three);
    return three(c, now, length, true, &flags[0], &flags[1], &flags[2], &last);
}

int fmu_discrete(const fmu *f, void *c) {
    bool flags[5];
    double time;
    event_info info;
    if (f->version == 2) {
        SYMBOL("NewDiscreteStates", int, (void *, event_info *), two);
        return two(c, &info);
    }
    SYMBOL("UpdateDiscreteStates", int, (void *, bool *, bool *, bool *, bool *, bool *, double *), three);
    return three(c, &flags[0], &flags[1], &flags[2], &flags[3], &flags[4], &time);
}

int fmu_completed(const fmu *f, void *c) {
    bool flags[2];
    int whole[2];
    if (f->version == 2) {
        SYMBOL("CompletedIntegratorStep", int, (void *, int, int *, int *), two);
        return two(c, 1, &whole[0], &whole[1]);
    }
    SYMBOL("CompletedIntegratorStep", int, (void *, bool, bool *, bool *), three);
    return three(c, true, &flags[0], &flags[1]);
}

uint64_t fmu_all(const fmu *f, bool known) {
    uint64_t set = 0;
    for (size_t v = 0; v < f->count; v++) set |= (uint64_t)(f->variables[v].known == known) << v;
    return set;
}

/* ---- the description ---- */

static char *read_description(const model *m) {
    char path[FOLDER + 32];
    (void)snprintf(path, sizeof path, "%s/out/modelDescription.xml", m->folder);
    FILE *file = fopen(path, "r");
    char *text = room(1 << 22, 1);
    if (file == NULL || fread(text, 1, (1 << 22) - 1, file) == 0) stop("no %s", path);
    (void)fclose(file);
    return text;
}

/* Copies the value of the attribute that follows `at`. */
static bool attribute(const char *at, const char *name, char *out, size_t size) {
    char words[160];
    (void)snprintf(words, sizeof words, " %s=\"", name);
    const char *value = at != NULL ? strstr(at, words) : NULL;
    if (value == NULL) return false;
    value += strlen(words);
    (void)snprintf(out, size, "%.*s", (int)strcspn(value, "\""), value);
    return true;
}

/* Adds a variable, whose reference stands behind its name in the description. */
static bool add_variable(fmu *f, const char *name, size_t count, bool known, finding *out) {
    char words[160], number[32];
    variable *v = &f->variables[f->count++];
    if (f->count == VARIABLES) stop("too many variables");
    *v = (variable){.count = count, .at = f->numbers, .known = known};
    f->numbers += count;
    (void)snprintf(v->name, sizeof v->name, "%s", name);
    const bool indexed = f->version == 2 && count > 1, rate = strncmp(name, "der(", 4) == 0;
    if (indexed && rate)
        (void)snprintf(words, sizeof words, " name=\"%.*s[1])\"", (int)strlen(name) - 1, name);
    else
        (void)snprintf(words, sizeof words, " name=\"%s%s\"", name, indexed ? "[1]" : "");
    const char *at = strstr(f->description, words);
    if (!attribute(at, "valueReference", number, sizeof number))
        return found(out, false, "the description has no%s", words);
    v->reference = (unsigned)strtoul(number, NULL, 10);
    return true;
}

static bool says(const fmu *f, const char *name) {
    char value[16];
    return attribute(f->description, name, value, sizeof value) && strcmp(value, "true") == 0;
}

static bool describe(fmu *f, finding *out) {
    size_t ins, outs;
    char name[160];
    const model *m = f->m;
    const size_t function = function_named(m, m->function);
    const lg_port *in = lg_program_inputs(m->program, function, &ins),
                  *to = lg_program_outputs(m->program, function, &outs);
    bool good =
        attribute(f->description, f->version == 2 ? "guid" : "instantiationToken", f->token, sizeof f->token);
    for (size_t i = 0; good && i < ins; i++) {
        good = add_variable(f, in[i].name, lg_shape_count(in[i].shape), true, out);
        if (i > 0 || !m->rate || !good) continue;
        (void)snprintf(name, sizeof name, "der(%s)", in[0].name);
        f->states = lg_shape_count(in[0].shape);
        good = add_variable(f, name, f->states, false, out);
    }
    for (size_t o = 0; good && o < outs; o++) {
        (void)snprintf(name, sizeof name, outs == 1 ? "%s" : "%s.%s", m->function, to[o].name);
        good = add_variable(f, name, lg_shape_count(to[o].shape), false, out);
    }
    good = good && add_variable(f, "longest_step", 1, true, out);
    f->forward =
        says(f, f->version == 2 ? "providesDirectionalDerivative" : "providesDirectionalDerivatives");
    f->adjoint = says(f, "providesAdjointDerivatives");
    return good;
}

/* ---- comparisons ---- */

typedef struct comparison {
    fmu *f;
    model *m;
    void *c;
    truth t;
    const lg_port *in, *out; /* of the function that t evaluates */
    double *numbers, *seeds;
} comparison;

static size_t variable_named(const fmu *f, const char *name) {
    for (size_t v = 0; v < f->count; v++)
        if (strcmp(f->variables[v].name, name) == 0) return v;
    stop("no variable %s", name);
}

/* Name of the variable of output `port` of function `of`, the exported one or the rate. */
static size_t variable_of_output(const comparison *c, const char *of, const char *port) {
    char name[160];
    size_t ins, outs;
    const size_t function = function_named(c->m, of);
    const lg_port *in = lg_program_inputs(c->m->program, function, &ins);
    (void)lg_program_outputs(c->m->program, function, &outs);
    if (strcmp(of, "rate") == 0)
        (void)snprintf(name, sizeof name, "der(%s)", in[0].name);
    else
        (void)snprintf(name, sizeof name, outs == 1 ? "%s" : "%s.%s", of, port);
    return variable_named(c->f, name);
}

/* Copies the numbers of the inputs of t whose names begin with `begin` to the places of their variables. */
static void take_inputs(const comparison *c, const char *begin, const char *of, double *to) {
    const size_t length = strlen(begin);
    for (size_t i = 0; i < c->t.inputs; i++) {
        const char *name = c->in[i].name;
        if (strncmp(name, begin, length) != 0 || (length == 0 && strchr(name, '_') != NULL)) continue;
        const variable *v =
            &c->f->variables[strcmp(begin, "adj_") == 0 ? variable_of_output(c, of, name + length)
                                                        : variable_named(c->f, name + length)];
        memcpy(to + v->at, input_of(&c->t, i), v->count * sizeof *to);
    }
}

static bool compare_output(const comparison *c, size_t o, size_t variable_at, const double *numbers,
                           finding *f) {
    char sentence[256];
    const variable *v = &c->f->variables[variable_at];
    return explained(&c->t, o, LG_F64, numbers + v->at, sentence, sizeof sentence) ||
           found(f, false, "%s: %s", v->name, sentence);
}

enum { VALUES, FORWARD, ADJOINT };

/* Compares the results of function `function` of the program: `of` itself or its derivative. */
static bool compare(comparison *c, const char *of, int what, finding *f) {
    double *got = room(c->f->numbers, sizeof *got);
    const uint64_t known = fmu_all(c->f, true), results = fmu_all(c->f, false);
    memset(c->seeds, 0, c->f->numbers * sizeof *c->seeds);
    take_inputs(c, "", of, c->numbers);
    bool good = fmu_set(c->f, c->c, known, c->numbers) == 0;
    if (what == FORWARD) take_inputs(c, "fwd_", of, c->seeds);
    if (what == ADJOINT) take_inputs(c, "adj_", of, c->seeds);
    if (what == VALUES) good = good && fmu_get(c->f, c->c, results, got) == 0;
    if (what == FORWARD) good = good && fmu_forward(c->f, c->c, results, known, c->seeds, got) == 0;
    if (what == ADJOINT) good = good && fmu_adjoint(c->f, c->c, results, known, c->seeds, got) == 0;
    if (!good) (void)found(f, false, "a call fails");
    for (size_t o = 0; good && o < c->t.outputs; o++) {
        const char *name = c->out[o].name;
        good = compare_output(c, o,
                              what == ADJOINT ? variable_named(c->f, name + strlen("adj_"))
                                              : variable_of_output(c, of, what == FORWARD ? name + 4 : name),
                              got, f);
    }
    free(got);
    return good;
}

static bool check_function(comparison *c, size_t function, const char *of, int what, lg_rng *rng,
                           finding *f) {
    size_t count;
    finding own;
    find_truth(c->t.tape, c->m->program, function, 1, rng, &c->t);
    c->in = lg_program_inputs(c->m->program, function, &count);
    c->out = lg_program_outputs(c->m->program, function, &count);
    tallied.functions++;
    tallied.unfit += !c->t.finite;
    return !c->t.finite || compare(c, of, what, &own) ||
           found(f, false, "%s: %.400s", lg_program_function_name(c->m->program, function), own.sentence);
}

/* Values, forward and adjoint derivatives of the exported function and of the rate. */
static bool check_results(comparison *c, lg_rng *rng, finding *f) {
    static const lg_derivative_kind kinds[] = {
        [FORWARD] = LG_DERIVATIVE_FORWARD, [ADJOINT] = LG_DERIVATIVE_ADJOINT};
    const char *const functions[] = {c->m->function, "rate"};
    const size_t parts = c->m->rate ? 2 : 1;
    bool good = true;
    for (int what = VALUES; good && what <= (c->f->version == 2 ? FORWARD : ADJOINT); what++) {
        size_t function[2] = {SIZE_MAX, SIZE_MAX};
        bool all = true;
        for (size_t p = 0; p < parts; p++) {
            function[p] = what == VALUES ? function_named(c->m, functions[p])
                                         : derivative_of(c->m, kinds[what], functions[p]);
            all = all && function[p] != SIZE_MAX;
        }
        if (all != (what == VALUES || (what == FORWARD ? c->f->forward : c->f->adjoint)))
            return found(f, false, "the description is wrong about derivatives");
        for (size_t p = 0; good && all && p < parts; p++)
            good = check_function(c, function[p], functions[p], what, rng, f);
    }
    return good;
}

/* A step of length 0.02 consists of two steps, because the longest step is 0.01. */
static bool check_step(comparison *c, lg_rng *rng, finding *f) {
    static const double longest = 0.01;
    size_t count;
    finding own;
    const size_t function = add_advanced(c->m, 2, longest);
    find_truth(c->t.tape, c->m->program, function, 1, rng, &c->t);
    c->in = lg_program_inputs(c->m->program, function, &count);
    tallied.functions++;
    tallied.unfit += !c->t.finite;
    if (!c->t.finite) return true;
    take_inputs(c, "", "rate", c->numbers);
    c->numbers[c->f->variables[c->f->count - 1].at] = longest;
    if (fmu_set(c->f, c->c, fmu_all(c->f, true), c->numbers) != 0 || fmu_step(c->f, c->c, 0.5, 0.02) != 0 ||
        fmu_get(c->f, c->c, 1, c->numbers) != 0)
        return found(f, false, "the step fails");
    return compare_output(c, 0, 0, c->numbers, &own) || found(f, false, "a step: %.400s", own.sentence);
}

static bool check_instance(fmu *f, model *m, finding *out) {
    const bool exchange = m->r->number % 2 == 1;
    comparison c = {.f = f, .m = m, .c = fmu_instantiate(f, exchange)};
    lg_rng rng;
    lg_rng_seed(&rng, m->r->number, 400);
    c.numbers = room(f->numbers, sizeof(double));
    c.seeds = room(f->numbers, sizeof(double));
    c.numbers[f->numbers - 1] = 0.01;
    if (lg_tape_create(NULL, NULL, &c.t.tape) != LG_OK) stop("no memory");
    bool good = (c.c != NULL && fmu_begin(f, c.c, 0) == 0 && f->leave(c.c) == 0) ||
                found(out, false, "the instance does not begin");
    good = good && check_results(&c, &rng, out);
    if (good && m->rate && !exchange) good = check_step(&c, &rng, out);
    lg_tape_destroy(c.t.tape);
    if (c.c != NULL) fmu_free(f, c.c);
    free(c.numbers);
    free(c.seeds);
    return good;
}

/* FMPy checks the whole FMU and simulates it. */
static bool check_file(const model *m, finding *out) {
    char answer[400] = "";
    return make_file(m, "%s.fmu", out) &&
           (!ask_peer(PEER_FMU, m, 1, answer, sizeof answer) || strcmp(answer, "ok") == 0 ||
            found(out, false, "FMPy: %s", answer));
}

static bool check(model *m, int version, finding *out) {
    static fmu f;
    f = (fmu){.m = m, .version = version, .description = read_description(m)};
#define LOAD(member, two, three, parameters)                                                                 \
    *(void **)&f.member = symbol_in(m, "fmi%d%s", version, version == 2 ? two : three);
    SAME_FUNCTIONS(LOAD)
#undef LOAD
    bool good = describe(&f, out);
    if (good && f.numbers > REFERENCES) stop("too many numbers");
    good = good && check_instance(&f, m, out) && check_calls(&f, out) && check_file(m, out);
    free(f.description);
    return good;
}

static bool check2(model *m, finding *out) {
    return check(m, 2, out);
}

static bool check3(model *m, finding *out) {
    return check(m, 3, out);
}

const target target_fmu2 = {.name = "fmu2", .blocks = true, .built = "%s.so", .check = check2};
const target target_fmu3 = {.name = "fmu3", .blocks = true, .built = "%s.so", .check = check3};
