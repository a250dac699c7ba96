#include "settings/names.h"

#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "liegrad/machine.h"

const char *lg_name_activation(uint32_t value) {
    return value < LG_ACTIVATION_COUNT ? lg_activation_name((lg_activation)value) : NULL;
}

const char *lg_name_scheme(uint32_t value) {
    return value < lg_scheme_count() ? lg_scheme_at(value)->name : NULL;
}

const void *lg_scheme_number(uint32_t value) {
    return lg_scheme_at(value);
}

const char *lg_name_family(uint32_t value) {
    return value < lg_hamiltonian_family_count() ? lg_hamiltonian_family_at(value)->name : NULL;
}

const void *lg_family_number(uint32_t value) {
    return lg_hamiltonian_family_at(value);
}

const char *lg_name_integral(uint32_t value) {
    return value < lg_first_integral_count() ? lg_first_integral_at(value)->name : NULL;
}

const char *lg_name_schedule(uint32_t value) {
    return value < LG_SCHEDULE_COUNT ? lg_schedule_name((lg_schedule_kind)value) : NULL;
}

const char *lg_name_surrogate_loss(uint32_t value) {
    return value < LG_SURROGATE_LOSS_COUNT ? lg_surrogate_loss_name((lg_surrogate_loss)value) : NULL;
}

const char *lg_name_surrogate(uint32_t value) {
    return value < LG_SURROGATE_KIND_COUNT ? lg_surrogate_kind_name((lg_surrogate_kind)value) : NULL;
}

const char *lg_name_net(uint32_t value) {
    return value < LG_NET_KIND_COUNT ? lg_net_kind_name((lg_net_kind)value) : NULL;
}

const char *lg_name_split(uint32_t value) {
    return value < LG_SPLIT_COUNT ? lg_split_name((lg_split)value) : NULL;
}

const char *lg_name_detector_loss(uint32_t value) {
    return value < LG_DETECTOR_LOSS_COUNT ? lg_detector_loss_name((lg_detector_loss)value) : NULL;
}

const char *lg_name_pooling(uint32_t value) {
    return value < LG_POOLING_COUNT ? lg_pooling_name((lg_pooling)value) : NULL;
}

#define NAMES(what, ...)                                                                                     \
    const char *lg_name_##what(uint32_t value) {                                                             \
        static const char *const names[] = {__VA_ARGS__};                                                    \
        return value < LG_COUNT(names) ? names[value] : NULL;                                                \
    }
NAMES(potential, [LG_POTENTIAL_MLP] = "mlp", [LG_POTENTIAL_LINEAR] = "linear",
      [LG_POTENTIAL_DICTIONARY] = "dictionary")
NAMES(symmetry, [LG_SYMMETRY_NONE] = "none", [LG_SYMMETRY_EVEN] = "even", [LG_SYMMETRY_ODD] = "odd")
NAMES(dtype, [LG_F64] = "f64", [LG_F32] = "f32")
NAMES(units, [LG_UNITS_GIVEN] = "given", [LG_UNITS_DATA] = "data")
NAMES(start, [LG_START_MEASURED] = "measured", [LG_START_ESTIMATED] = "estimated")
NAMES(machine_start, [LG_MACHINE_STARTS_MEASURED] = "measured", [LG_MACHINE_STARTS_ESTIMATED] = "estimated")
NAMES(distance, [LG_DISTANCE_AMBIENT] = "ambient", [LG_DISTANCE_GEODESIC] = "geodesic")
NAMES(penalty_form, [LG_PENALTY_MEAN_SQUARE] = "text", [LG_PENALTY_SUM_ABSOLUTE] = "published")
NAMES(surrogate_penalty, [LG_SURROGATE_DIFFERENCES] = "published", [LG_SURROGATE_WEIGHTED] = "text")
NAMES(values, [false] = "discrete", [true] = "continuous")
NAMES(truth, [false] = "false", [true] = "true")
NAMES(yes, [false] = "no", [true] = "yes")
NAMES(noise, [LG_NOISE_NORMAL] = "normal", [LG_NOISE_UNIFORM] = "uniform")

enum { MOST_VALUES = 32 };

/* Every parameter is a unit vector, which for one number is 1, positive and finite. The family does not
 * depend on the parameters. */
static lg_status make_system(const char *name, const char *form, lg_system **out) {
    double unit[MOST_VALUES] = {1.0};
    lg_named_values given[LG_MOST_PARAMETERS];
    lg_system_options options;
    size_t count = 0;
    const lg_parameter_entry *row = lg_system_parameters(name, form);
    for (; row != NULL && row->key != NULL && count < LG_MOST_PARAMETERS; row++)
        if (row->fallback == NULL && row->count <= MOST_VALUES)
            given[count++] = (lg_named_values){row->key, unit, row->count > 0 ? row->count : 1};
    lg_system_options_init(&options);
    options.form = form;
    options.parameters = given;
    options.parameter_count = count;
    return lg_system_create(NULL, name, &options, out, NULL);
}

/* Forms of a system that may be learned, the first that is. */
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

lg_status lg_missing_is_format(lg_status status, lg_error *error) {
    if (status != LG_NOT_FOUND) return status;
    if (error != NULL) error->status = LG_FORMAT;
    return LG_FORMAT;
}
