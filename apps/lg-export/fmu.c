/* FMUs (fmi-standard.org, versions 2.0 and 3.0): model exchange and co-simulation in one file, with sources.
 * Both versions offer exact directional derivatives, computed by the program's forward functions; 3.0 also
 * offers adjoint derivatives. */
#include <string.h>

#include "lg-export/block.h"

typedef struct job {
    block b;
    int version;
    char token[64];
} job;

/* ---- C code ---- */

static void add_source(job *j) {
    const char *name = j->b.source->options->name;
    text *to = export_add_file(j->b.source, "%s_fmu.c");
    lg_text_add(to,
                "/* The model as an FMU, FMI %d.0; %s.h says what it is. Written by lg-export. */\n"
                "#include <float.h>\n#include <math.h>\n#include <stdbool.h>\n#include <stdint.h>\n"
                "#include <stdlib.h>\n#include <string.h>\n\n#include \"%s.h\"\n\n",
                j->version, name, name);
    lg_text_add(to, "#define TOKEN \"%s\"\n\n", j->token);
    block_add_tables(&j->b, to);
    block_add_evaluate(&j->b, to);
    block_add_forward(&j->b, to);
    if (j->version > 2) block_add_adjoint(&j->b, to); /* FMI 2.0 has no adjoint derivatives. */
    block_add_step(&j->b, to);
    lg_text_add(to, "#define HAS_STATES %d\n", j->b.rate);
    lg_text_add(to, "%s\n%s\n%s", export_fragment_text("fmu_core"),
                export_fragment_text(j->version == 2 ? "fmi2" : "fmi3"), export_fragment_text("fmu_calls"));
}

/* ---- XML ---- */

static void add_escaped(text *to, const char *s) {
    for (; *s != '\0'; s++) {
        if (*s == '<')
            lg_text_add(to, "&lt;");
        else if (*s == '&')
            lg_text_add(to, "&amp;");
        else if (*s == '"')
            lg_text_add(to, "&quot;");
        else
            lg_text_append(to, s, 1);
    }
}

static void add_attribute(text *to, const char *name, const char *value) {
    lg_text_add(to, " %s=\"", name);
    add_escaped(to, value);
    lg_text_add(to, "\"");
}

static void add_units(const job *j, text *to) {
    bool any = false;
    for (size_t i = 0; i < j->b.count; i++) {
        const char *unit = j->b.variables[i].unit;
        bool known = unit == NULL;
        for (size_t k = 0; k < i; k++)
            known = known || (j->b.variables[k].unit != NULL && strcmp(j->b.variables[k].unit, unit) == 0);
        if (known) continue;
        lg_text_add(to, "%s    <Unit", any ? "" : "  <UnitDefinitions>\n");
        add_attribute(to, "name", unit);
        lg_text_add(to, "/>\n");
        any = true;
    }
    if (any) lg_text_add(to, "  </UnitDefinitions>\n");
}

static const struct {
    const char *causality, *variability, *initial; /* NULL: the attribute is not written. */
    bool start;
} xml[CAUSALITIES] = {[STATE] = {"local", "continuous", "exact", true},
                      [DERIVATIVE] = {"local", "continuous", "calculated", false},
                      [INPUT] = {"input", "continuous", NULL, true},
                      [OUTPUT] = {"output", "continuous", "calculated", false},
                      [PARAMETER] = {"parameter", "tunable", "exact", true}};

static const char longest_step[] =
    "Co-simulation: no internal step is longer, in units of time; the interval of the data by default";

/* Returns whether the variable is an output of the FMU. If the block has no outputs, the FMU's output is the
 * state. */
static bool is_output(const block *b, const variable *v) {
    bool any = false;
    for (size_t i = 0; i < b->count; i++) any = any || b->variables[i].kind == OUTPUT;
    return v->kind == (any ? OUTPUT : STATE);
}

enum { WHOLE = -1 };

/* Adds line k of `each`, or `whole` if k is WHOLE or `each` is empty. */
static void add_words(text *to, const text *each, const text *whole, long k) {
    const char *line = k != WHOLE && each->length > 0 ? each->data : NULL;
    for (long i = 0; line != NULL && i < k; i++) line = strchr(line, '\n') + 1;
    if (line != NULL)
        lg_text_append(to, line, strcspn(line, "\n"));
    else
        lg_text_add(to, "%s", whole->data != NULL ? whole->data : "");
}

/* Adds a description of number k of the variable, or of all its numbers if k is WHOLE. */
static void add_meaning(const block *b, text *to, const variable *v, long k) {
    const export_source *source = b->source;
    APP_CLEAN(lg_text_destroy) text words = app_text();
    const bool input = v->kind == INPUT && strcmp(v->name, "u") == 0;
    if (v == &b->variables[b->count - 1])
        lg_text_add(&words, "%s", longest_step);
    else if (v->kind == STATE)
        add_words(&words, &source->places, &source->state, k);
    else if (input)
        add_words(&words, &source->inputs_each, &source->input, k);
    if (input && source->delay.length > 0)
        lg_text_add(&words, "; %s: delay them yourself", source->delay.data);
    if (words.length > 0) add_attribute(to, "description", words.data);
}

static void add_kind(const block *b, text *to, const variable *v, long k) {
    lg_text_add(to, " causality=\"%s\" variability=\"%s\"",
                is_output(b, v) ? "output" : xml[v->kind].causality, xml[v->kind].variability);
    if (xml[v->kind].initial != NULL) lg_text_add(to, " initial=\"%s\"", xml[v->kind].initial);
    add_meaning(b, to, v, k);
}

/* Adds the name of number k of a variable: "x[2]", "der(x[2])", "value"; of all its numbers if k is WHOLE. */
static void add_name(text *to, const variable *v, long k) {
    char name[200];
    const char *close = v->kind == DERIVATIVE ? ")" : "";
    const int stem = (int)(strlen(v->name) - strlen(close));
    if (v->count == 1 || k == WHOLE)
        (void)snprintf(name, sizeof name, "%s", v->name);
    else
        (void)snprintf(name, sizeof name, "%.*s[%ld]%s", stem, v->name, k + 1, close);
    add_attribute(to, "name", name);
}

/* FMI 2.0 has a variable for each number, 3.0 one for all numbers of a variable. */
static void add_variables(const job *j, text *to) {
    const bool scalars = j->version == 2;
    lg_text_add(to, "  <ModelVariables>\n");
    for (size_t i = 0; i < j->b.count; i++) {
        const variable *v = &j->b.variables[i];
        const size_t each = scalars ? 1 : v->count;
        for (size_t k = 0; k < v->count; k += each) {
            lg_text_add(to, scalars ? "    <ScalarVariable" : "    <Float64");
            add_name(to, v, scalars ? (long)k : WHOLE);
            lg_text_add(to, " valueReference=\"%zu\"", scalars ? v->at + k : i);
            add_kind(&j->b, to, v, scalars ? (long)k : WHOLE);
            if (scalars) lg_text_add(to, "><Real");
            if (v->unit != NULL) add_attribute(to, "unit", v->unit);
            if (v->kind == DERIVATIVE) lg_text_add(to, " derivative=\"%zu\"", scalars ? k + 1 : 0);
            for (size_t n = k; n < k + each && xml[v->kind].start; n++)
                lg_text_add(to, "%s%.17g%s", n == k ? " start=\"" : " ", block_start(&j->b, i, n),
                            n + 1 == k + each ? "\"" : "");
            if (!scalars && v->count > 1)
                lg_text_add(to, "><Dimension start=\"%zu\"/></Float64>\n", v->count);
            if (scalars || v->count == 1) lg_text_add(to, scalars ? "/></ScalarVariable>\n" : "/>\n");
        }
    }
    if (!scalars)
        lg_text_add(to,
                    "    <Float64 name=\"time\" valueReference=\"%zu\" causality=\"independent\" "
                    "variability=\"continuous\"/>\n",
                    j->b.count);
    lg_text_add(to, "  </ModelVariables>\n");
}

/* Lists derivatives, outputs or both: in FMI 2.0 as <Unknown index=.../> for each number, with indices from 1
 * on, in FMI 3.0 by variable. */
static void add_unknowns(const job *j, const char *element, bool derivatives, bool outputs, text *to) {
    bool any = false;
    for (size_t i = 0; i < j->b.count; i++) {
        const variable *v = &j->b.variables[i];
        const bool here = (v->kind == DERIVATIVE && derivatives) ||
                          (is_output(&j->b, v) && outputs && (v->kind == OUTPUT || !derivatives));
        if (here && j->version > 2) lg_text_add(to, "    <%s valueReference=\"%zu\"/>\n", element, i);
        for (size_t k = 0; k < v->count && here && j->version == 2; k++) {
            if (!any) lg_text_add(to, "    <%s>\n", element);
            lg_text_add(to, "      <Unknown index=\"%zu\"/>\n", v->at + k + 1);
            any = true;
        }
    }
    if (any) lg_text_add(to, "    </%s>\n", element);
}

static void add_common(const job *j, text *to) {
    APP_CLEAN(lg_text_destroy) text about = app_text();
    lg_text_add(&about, "%s", lg_program_description(j->b.program));
    if (j->b.source->delay.length > 0)
        lg_text_add(&about, "%s%s: delay them yourself", about.length > 0 ? "; " : "",
                    j->b.source->delay.data);
    lg_text_add(to, "\n ");
    add_attribute(to, "modelName", j->b.source->options->name);
    lg_text_add(to, " %s=\"%s\"\n ", j->version == 2 ? "guid" : "instantiationToken", j->token);
    if (about.length > 0) add_attribute(to, "description", about.data);
    lg_text_add(to, " generationTool=\"lg-export of liegrad %s\" variableNamingConvention=\"structured\"",
                lg_version());
}

static void add_interfaces(const job *j, text *to) {
    const char *name = j->b.source->options->name, *forward = block_has(&j->b, true) ? "true" : "false",
               *adjoint = block_has(&j->b, false) ? "true" : "false";
    for (int co = 0; co < 2; co++) {
        const char *kind = co ? "CoSimulation" : "ModelExchange",
                   *steps = co ? " canHandleVariableCommunicationStepSize=\"true\"" : "";
        if (j->version == 2)
            lg_text_add(
                to,
                "  <%s modelIdentifier=\"%s\" canGetAndSetFMUstate=\"true\" canSerializeFMUstate=\"true\" "
                "providesDirectionalDerivative=\"%s\"%s>\n    <SourceFiles><File name=\"%s_fmu.c\"/>"
                "<File name=\"%s.c\"/><File name=\"%s_weights.c\"/></SourceFiles>\n  </%s>\n",
                kind, name, forward, steps, name, name, name, kind);
        else
            lg_text_add(
                to,
                "  <%s modelIdentifier=\"%s\" canGetAndSetFMUState=\"true\" canSerializeFMUState=\"true\" "
                "providesDirectionalDerivatives=\"%s\" providesAdjointDerivatives=\"%s\"%s/>\n",
                kind, name, forward, adjoint, steps);
    }
}

/* The default experiment ends at the scene's end, or after 1 unit of time. */
static void add_description(const job *j, text *to) {
    static const char *const elements[][3] = {{"Outputs", "Derivatives", "InitialUnknowns"},
                                              {"Output", "ContinuousStateDerivative", "InitialUnknown"}};
    const char *const *element = elements[j->version - 2];
    lg_text_add(to, "<fmiModelDescription fmiVersion=\"%d.0\"", j->version);
    add_common(j, to);
    lg_text_add(to, j->version == 2 ? " numberOfEventIndicators=\"0\">\n" : ">\n");
    add_interfaces(j, to);
    add_units(j, to);
    lg_text_add(to, "  <DefaultExperiment startTime=\"0\" stopTime=\"%.17g\"/>\n",
                j->b.source->stop > 0 ? j->b.source->stop : 1);
    add_variables(j, to);
    lg_text_add(to, "  <ModelStructure>\n");
    add_unknowns(j, element[0], false, true, to);
    add_unknowns(j, element[1], true, false, to);
    add_unknowns(j, element[2], true, true, to);
    lg_text_add(to, "  </ModelStructure>\n</fmiModelDescription>\n");
}

static void add_build(const job *j, text *to) {
    const char *name = j->b.source->options->name;
    lg_text_add(
        to,
        "<fmiBuildDescription fmiVersion=\"3.0\">\n  <BuildConfiguration modelIdentifier=\"%s\">\n"
        "    <SourceFileSet language=\"C99\"><SourceFile name=\"%s_fmu.c\"/><SourceFile name=\"%s.c\"/>"
        "<SourceFile name=\"%s_weights.c\"/></SourceFileSet>\n    <Library name=\"m\"/>\n"
        "  </BuildConfiguration>\n</fmiBuildDescription>\n",
        name, name, name, name);
}

/* ---- Makefile ---- */

static void add_rules(job *j) {
    lg_text_add(&j->b.source->rules, "BINARIES ?= %s\n",
                j->version == 2 ? "linux64" : "$(shell uname -m)-linux");
    export_add_rules(j->b.source, "NAME_.fmu NAME_.so", export_fragment_text("fmu.gmake"));
}

/* Makes the identifier (guid or instantiation token) that the caller must give when it makes an instance:
 * taken from the SHA-256 of the model's file. */
static void make_token(job *j) {
    const char *s = j->b.source->options->sha256[0] != '\0' ? j->b.source->options->sha256
                                                            : "00000000000000000000000000000000";
    (void)snprintf(j->token, sizeof j->token, "{%.8s-%.4s-%.4s-%.4s-%.12s}", s, s + 8, s + 12, s + 16,
                   s + 20);
}

static void export_fmu(const app *self, const char *path, lg_program *program, export_source *source,
                       int version) {
    APP_FREE job *j = app_alloc(1, sizeof *j);
    *j = (job){.b = {.self = self, .program = program, .source = source}, .version = version};
    block_collect(&j->b, true);
    source->prefix = "c_";
    export_whole(self, path, program, &j->b.list, source);
    make_token(j);
    add_rules(j);
    export_compose(source);
    add_source(j);
    add_description(j, export_add_file(source, "modelDescription.xml"));
    if (version > 2) add_build(j, export_add_file(source, "buildDescription.xml"));
}

static void build2(const app *self, const char *path, lg_program *program, export_source *source) {
    export_fmu(self, path, program, source, 2);
}

static void build3(const app *self, const char *path, lg_program *program, export_source *source) {
    export_fmu(self, path, program, source, 3);
}

const export_target export_target_fmu2 = {.build = build2, .tunable = true, .wide = "an FMU computes"};
const export_target export_target_fmu3 = {.build = build3, .tunable = true, .wide = "an FMU computes"};
