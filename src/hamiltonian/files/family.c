#include "hamiltonian/files/family.h"

#include <stdio.h>

#include "core/core.h"

/* Makes the system with default parameters. A parameter without a default becomes a unit vector, or 1 if it
 * is one number: the family does not depend on the parameters' values. */
static lg_status make_system(const char *name, const char *form, lg_system **out) {
    const double unit[LG_MOST_VALUES] = {1.0};
    lg_named_values given[LG_MOST_PARAMETERS];
    lg_system_options options;
    size_t count = 0;
    const lg_parameter_entry *row = lg_system_parameters(name, form);
    for (; row != NULL && row->key != NULL; row++)
        if (row->fallback == NULL)
            given[count++] = (lg_named_values){row->key, unit, row->count > 0 ? row->count : 1};
    lg_system_options_init(&options);
    options.form = form;
    options.parameters = given;
    options.parameter_count = count;
    return lg_system_create(NULL, name, &options, out, NULL);
}

/* Forms of a system that may be learned. The first one that a family learns is taken. */
static const char *const forms[] = {"hamiltonian", NULL};

static const lg_hamiltonian_family *family_of_form(const char *system, const char *form, size_t *n) {
    const lg_hamiltonian_family *family;
    lg_system *made;
    if (make_system(system, form, &made) != LG_OK) return NULL;
    family = lg_hamiltonian_family_for(made, n);
    if (lg_system_links(made) > 0) *n = 0;
    lg_system_destroy(made);
    return family;
}

const lg_hamiltonian_family *lg_family_of(const char *system, size_t *n) {
    const lg_hamiltonian_family *family = NULL;
    for (size_t i = 0; i < LG_COUNT(forms) && family == NULL; i++)
        family = family_of_form(system, forms[i], n);
    return family;
}

const char *lg_learned_form(const char *system) {
    size_t n;
    return family_of_form(system, forms[0], &n) != NULL ? forms[0] : NULL;
}

void lg_layout_text(const lg_hamiltonian_family *family, uint32_t n, char text[LG_LAYOUT_TEXT]) {
    size_t used = 0;
    text[0] = '\0';
    for (uint32_t i = 1; i <= (family->numbered ? n : 1); i++)
        for (const char *const *part = family->layout; *part != NULL && used < LG_LAYOUT_TEXT; part++) {
            const char *between = used > 0 ? " " : "";
            char number[12] = "";
            if (family->numbered) (void)snprintf(number, sizeof number, "%u", i);
            used += (size_t)snprintf(text + used, LG_LAYOUT_TEXT - used, "%s%s%s", between, *part, number);
        }
}
