/* Models of kinds that have no row in the table: words are made from the file and the program's ports. */
#include "lg-export/faces.h"

/* Adds a line for each input and output: "x of velocity, in m". */
static void tell_ports(const export_model *m, const char *function, text *about) {
    const export_ports p = export_ports_of(m->program, function);
    for (size_t i = 0; i < p.ins + p.outs; i++) {
        const lg_port *port = i < p.ins ? &p.in[i] : &p.out[i - p.ins];
        const char *unit = port->unit != NULL ? port->unit : "";
        APP_FREE char *words =
            app_format("%s of %s%s%s", port->name, function, unit[0] != '\0' ? ", in " : "", unit);
        export_tell_numbers(about, i < p.ins ? "input" : "output", lg_shape_count(port->shape), words);
    }
}

static void tell(export_model *m) {
    text *about = &m->source->about;
    const char *description = lg_program_description(m->program);
    char space[LG_SPACE_TEXT];
    lg_text_add(about, "%s\n\n", description[0] != '\0' ? description : "A model of functions.");
    if (m->space != NULL) {
        lg_space_text(m->space, space);
        lg_text_add(about, "space         %s\n", space);
    }
    for (size_t i = 0; i < m->count; i++) tell_ports(m, m->functions[i].function, about);
    export_units(m->source, "as the functions say");
    if (export_has(m, &export_face_motion)) export_tell_motion(m);
    export_file_provenance(m->self, m->source, m->self->arguments[0]);
}

const export_kind export_kind_other = {.recipe = NULL, .tell = tell};
