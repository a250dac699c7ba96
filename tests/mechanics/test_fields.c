/* fields/written.inc: the fields and energies of systems as straight C, written from their recordings. Writes
 * the file anew with LG_WRITE_PAGES=1. */
#include "mechanics/system_check.h"

#include <ctype.h>
#include <stdio.h>

#include "autodiff/program/program.h"
#include "mechanics/system.h"

static const char header[] =
    "/* clang-format off */\n"
    "/* Fields and energies of systems, written by test_fields from their recordings: run it with\n"
    " * LG_WRITE_PAGES=1 after a change of a recording. `number` is a double, or one number of many members "
    "of\n"
    " * an ensemble; functions with branches, sines and energies are for doubles only. */\n\n"
    "static inline void field_copy(int n, const number *x, number *y) {\n"
    "    for (int i = 0; i < n; i++) y[i] = x[i];\n"
    "}\n";

/* The system's functions without the macros before them, where `real` is `number` and helpers have the system's
 * name. */
static void put_code(FILE *out, const char *code, const char *name) {
    const char *const words[][2] = {{"static NOINLINE void scalars_", "static inline void "},
                                    {"scalars_", ""},
                                    {"\nvoid ", "\nstatic inline void "},
                                    {"const real ", "const number "},
                                    {"real *", "number *"},
                                    {"    copy(", "    field_copy("},
                                    {"REAL(", "FIELD_NUMBER("},
                                    {"SQRT(", "FIELD_SQRT("},
                                    {"SIN(", "FIELD_SIN("},
                                    {"COS(", "FIELD_COS("},
                                    {"EXP(", "exp("},
                                    {"LOG(", "log("},
                                    {"POW(", "pow("},
                                    {"FABS(", "fabs("},
                                    {"ATAN2(", "atan2("},
                                    {"    if (y0 == NULL) y0 = work;\n", ""}};
    for (const char *at = code; *at != '\0';) {
        const char *value = strncmp(at, "    y0[", 7) == 0 ? strstr(at, "] = ") + 4 : NULL;
        size_t i = 0;
        while (i < LG_COUNT(words) && strncmp(at, words[i][0], strlen(words[i][0])) != 0) i++;
        if (value != NULL && *value != 'v') { /* a number that is the same for all members */
            (void)fprintf(out, "%.*sFIELD_NUMBER(%.*s);", (int)(value - at), at, (int)strcspn(value, ";"),
                          value);
            at = value + strcspn(value, ";") + 1;
        } else if (i == LG_COUNT(words)) {
            (void)fputc(*at++, out);
        } else {
            (void)fprintf(out, "%s%s%s", words[i][1], i < 2 ? name : "", i < 2 ? "_" : "");
            at += strlen(words[i][0]);
        }
    }
}

/* Fails if the code calls what put_code does not know, such as tanh_of. True if it needs doubles: it has a branch or
 * calls a function that lanes do not have. */
static bool needs_doubles(const char *code, const char *name) {
    static const char *const others[] = {"for", "if", "copy", "REAL"};
    static const char *const functions[] = {"SQRT", "SIN", "COS", "EXP", "LOG", "POW", "FABS", "ATAN2"};
    const size_t length = strlen(name);
    bool plain = strstr(code, " ? ") != NULL;
    for (const char *at = strchr(code, '('); at != NULL; at = strchr(at + 1, '(')) {
        const char *begin = at;
        while (begin > code && (isalnum((unsigned char)begin[-1]) || begin[-1] == '_')) begin--;
        const size_t size = (size_t)(at - begin);
        bool known = size == 0 || strncmp(begin, "scalars_", 8) == 0 ||
                     (strncmp(begin, name, length) == 0 && begin[length] == '_');
        for (size_t i = 0; i < LG_COUNT(others); i++)
            known = known || (strlen(others[i]) == size && strncmp(others[i], begin, size) == 0);
        for (size_t i = 0; i < LG_COUNT(functions); i++)
            if (strlen(functions[i]) == size && strncmp(functions[i], begin, size) == 0) known = plain = true;
        if (!known) fail_msg("%s: this test cannot write %.*s()", name, (int)size, begin);
    }
    return plain;
}

static void put_system(FILE *lanes, FILE *others, FILE *list, const lg_system *system) {
    const char *form = lg_system_form(system);
    char name[64];
    lg_program *program = NULL;
    lg_c_source *source = NULL;
    lg_c_options options;
    assert_int_equal(lg_recorded_program(system, &program, NULL), LG_OK);
    (void)snprintf(name, sizeof name, "%s%s%s", lg_system_name(system), form != NULL ? "_" : "",
                   form != NULL ? form : "");
    for (char *c = name; *c != '\0'; c++)
        if (*c == '-') *c = '_';
    const size_t functions = lg_program_functions(program);
    const char *last = functions > 1 ? lg_program_function_name(program, 1) : NULL;
    const bool energy = last != NULL && strcmp(last, "energy") == 0;
    lg_c_options_init(&options);
    options.name = name;
    options.mark_unfit = false;
    assert_int_equal(lg_program_write_c(program, &options, &source, NULL), LG_OK);
    assert_int_equal(source->numbers + source->integers, 0);
    const char *code = strstr(source->code, "static NOINLINE void scalars_"),
               *public = strstr(source->code, "\nvoid ");
    assert_non_null(public);
    if (code == NULL || code > public) code = public;
    const bool plain = needs_doubles(code, name) || energy;
    put_code(plain ? others : lanes, code, name);
    (void)fputc('\n', plain ? others : lanes);
    (void)fprintf(list, " \\\n    {\"%s\", \"%s\", {%s_%s, %s%s%s}, %zu},", lg_system_name(system),
                  form != NULL ? form : "", name, lg_program_function_name(program, 0),
                  last != NULL ? name : "NULL", last != NULL ? "_" : "", last != NULL ? last : "",
                  source->work_size > 1 ? source->work_size : 0);
    lg_c_source_destroy(source);
    lg_program_destroy(program);
}

/* The text of the file. */
static char *write_all(void) {
    char *text[4] = {NULL};
    size_t size[4];
    FILE *out[4];
    const char *name, *form;
    static const double one = 1.0;
    for (int i = 0; i < 4; i++) assert_non_null(out[i] = open_memstream(&text[i], &size[i]));
    for (size_t i = 0; lg_system_at(i, &name, &form); i++) {
        lg_system_options options;
        lg_named_values given[8];
        lg_system_options_init(&options);
        options.form = form;
        options.parameters = given;
        for (const lg_parameter_entry *p = lg_system_parameters(name, form); p->key != NULL; p++)
            if (p->fallback == NULL) given[options.parameter_count++] = (lg_named_values){p->key, &one, 1};
        const lg_system *system = make_system_with(name, &options);
        if (system->row->field[LG_COORDINATES_LIE] == lg_recorded_field ||
            system->row->force == lg_recorded_force)
            put_system(out[1], out[2], out[3], system);
    }
    for (int i = 1; i < 4; i++) (void)fclose(out[i]);
    (void)fprintf(out[0], "%s\n%s#ifndef FIELD_ON_LANES\n\n%s#define LG_WRITTEN_SYSTEMS%s\n\n#endif\n",
                  header, text[1], text[2], text[3]);
    (void)fclose(out[0]);
    for (int i = 1; i < 4; i++) free(text[i]);
    return text[0];
}

TEST("fields/written.inc is written from the recordings of the systems") {
#ifdef __clang__
    skip(); /* C leaves the order of arguments open: clang records the same operations in another order */
#endif
    static const char path[] = LG_TEST_DIR "/../src/mechanics/fields/written.inc";
    char *wanted = write_all(), *found = NULL;
    size_t room = 0;
    if (getenv("LG_WRITE_PAGES") != NULL) {
        FILE *file = fopen(path, "w");
        assert_non_null(file);
        (void)fputs(wanted, file);
        (void)fclose(file);
    }
    FILE *file = fopen(path, "r");
    assert_non_null(file);
    if (getdelim(&found, &room, '\0', file) < 0) fail_msg("%s cannot be read", path);
    (void)fclose(file);
    if (strcmp(found, wanted) != 0) fail_msg("%s is old: run this test with LG_WRITE_PAGES=1", path);
    free(wanted);
    free(found);
}
