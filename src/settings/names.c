#include "settings/names.h"

#include "liegrad/fit.h"
#include "liegrad/integrators.h"
#include "liegrad/networks.h"

const char *lg_name_activation(uint32_t value) {
    return value < LG_ACTIVATION_COUNT ? lg_activation_name((lg_activation)value) : NULL;
}

const char *lg_name_scheme(uint32_t value) {
    return value < lg_scheme_count() ? lg_scheme_at(value)->name : NULL;
}

const void *lg_scheme_number(uint32_t value) {
    return lg_scheme_at(value);
}

const char *lg_name_schedule(uint32_t value) {
    return value < LG_SCHEDULE_COUNT ? lg_schedule_name((lg_schedule_kind)value) : NULL;
}

const char *lg_name_net(uint32_t value) {
    return value < LG_NET_KIND_COUNT ? lg_net_kind_name((lg_net_kind)value) : NULL;
}

const char *lg_name_truth(uint32_t value) {
    return value > 1 ? NULL : value == 1 ? "true" : "false";
}

const char *lg_name_yes(uint32_t value) {
    return value > 1 ? NULL : value == 1 ? "yes" : "no";
}

const char *lg_name_values(uint32_t value) {
    return value > 1 ? NULL : value == 1 ? "continuous" : "discrete";
}
