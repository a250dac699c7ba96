/* Converts training plans (sequences of methods) from and to text; names of schemes. */
#include "settings/training.h"

#include <stdio.h>

#include "liegrad/fit.h"
#include "liegrad/integrators.h"

const char *lg_name_scheme(uint32_t value) {
    return value < lg_scheme_count() ? lg_scheme_at(value)->name : NULL;
}

const void *lg_scheme_number(uint32_t value) {
    return lg_scheme_at(value);
}

lg_status lg_plan_parse_squares(const char *text, void *member, lg_error *error) {
    return lg_fit_plan_parse(text, true, member, error);
}

lg_status lg_plan_parse_any_loss(const char *text, void *member, lg_error *error) {
    return lg_fit_plan_parse(text, false, member, error);
}

const char *lg_plan_name_any_loss(uint32_t value) {
    for (lg_fit_method method = 0; lg_fit_method_name(method) != NULL; method++)
        if (!lg_fit_method_squares(method) && value-- == 0) return lg_fit_method_name(method);
    return NULL;
}

void lg_plan_show(const void *member, char *text, size_t size) {
    char plan[LG_FIT_PLAN_TEXT];
    lg_fit_plan_show(member, plan);
    (void)snprintf(text, size, "%s", plan);
}
