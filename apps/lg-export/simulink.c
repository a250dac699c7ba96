/* Simulink: plain functions for C Function blocks (NAME_simulink.h and .c) and an S-function
 * (NAME_sfun.c). */
#include "lg-export/block.h"

/* Adds a prototype: "void NAME_field(const double x[6], const double u[3], double f[6])". */
static void add_prototype(const block *b, const char *function, text *to) {
    const char *comma = "";
    const export_ports p = export_ports_of(b->program, function);
    lg_text_add(to, "void %s_%s(", b->source->options->name, function);
    for (size_t i = 0; i < p.ins + p.outs; i++, comma = ", ") {
        const lg_port *port = i < p.ins ? &p.in[i] : &p.out[i - p.ins];
        lg_text_add(to, "%s%sdouble %s[%zu]", comma, i < p.ins ? "const " : "", port->name,
                    lg_shape_count(port->shape));
    }
    lg_text_add(to, ")");
}

static void add_call(const block *b, const char *function, text *to) {
    const char *name = b->source->options->name;
    const export_ports p = export_ports_of(b->program, function);
    lg_text_add(to, " {\n    double work[%s_%s%s_WORK_SIZE + 1];\n    %s_%s%s(", name, b->source->prefix,
                function, name, b->source->prefix, function);
    for (size_t i = 0; i < p.ins; i++) lg_text_add(to, "%s, ", p.in[i].name);
    for (size_t o = 0; o < p.outs; o++) lg_text_add(to, "%s, ", p.out[o].name);
    lg_text_add(to, "work);\n}\n\n");
}

/* Adds the two files for C Function blocks: one function per block, with its work memory on the stack. */
static void add_functions(const block *b) {
    const char *name = b->source->options->name;
    text *header = export_add_file(b->source, "%s_simulink.h"),
         *code = export_add_file(b->source, "%s_simulink.c");
    lg_text_add(
        header,
        "/* Functions of %s.h for C Function blocks: add this header, %s_simulink.c, %s.c and %s_weights.c "
        "to the\n * model's custom code. Work memory is on the stack. Written by lg-export.\n",
        name, name, name, name);
    export_add_words(b->source, header);
    lg_text_add(header, " */\n#ifndef %s_SIMULINK_H\n#define %s_SIMULINK_H\n\n", name, name);
    lg_text_add(code,
                "/* %s_simulink.h says what this is. */\n#include \"%s_simulink.h\"\n\n#include \"%s.h\"\n\n",
                name, name, name);
    for (size_t i = 0; i < b->list.count; i++) {
        add_prototype(b, b->list.name[i], header);
        lg_text_add(header, ";\n");
        add_prototype(b, b->list.name[i], code);
        add_call(b, b->list.name[i], code);
    }
    lg_text_add(header, "\n#endif\n");
}

static void add_sfunction(const block *b) {
    const char *name = b->source->options->name;
    text *to = export_add_file(b->source, "%s_sfun.c");
    lg_text_add(to,
                "/* %s as an S-function: mex %s_sfun.c %s.c %s_weights.c. %s.h says what it is. Written by "
                "lg-export.\n",
                name, name, name, name, name);
    export_add_words(b->source, to);
    lg_text_add(to,
                " */\n#define S_FUNCTION_NAME %s_sfun\n#define S_FUNCTION_LEVEL 2\n#include <string.h>\n\n"
                "#include \"%s.h\"\n\n",
                name, name);
    block_add_tables(b, to);
    block_add_evaluate(b, to);
    lg_text_add(to, "#define HAS_STATES %d\n\n%s", b->rate, export_fragment_text("sfunction"));
}

static const char rules[] = "NAME_simulink.o: NAME_simulink.c NAME_simulink.h NAME_.h\n"
                            "\t$(CC) $(CFLAGS) -c NAME_simulink.c -o NAME_simulink.o\n";

static void build(const app *self, const char *path, lg_program *program, export_source *source) {
    APP_FREE block *b = app_alloc(1, sizeof *b);
    *b = (block){.self = self, .program = program, .source = source};
    block_collect(b, false);
    source->prefix = "c_";
    export_whole(self, path, program, &b->list, source);
    export_add_rules(source, "NAME_simulink.o", rules);
    export_compose(source);
    add_functions(b);
    add_sfunction(b);
}

const export_target export_target_simulink = {.build = build, .wide = "the blocks are"};
