#include "datasets/names.h"

#include <stdio.h>
#include <string.h>

#include "core/core.h"

const char *lg_name_activation(uint32_t value) {
    return value < LG_ACTIVATION_COUNT ? lg_activation_name((lg_activation)value) : NULL;
}

const char *lg_name_integrator(uint32_t value) {
    return value < LG_TRAIN_INTEGRATOR_COUNT ? lg_train_integrator_name((lg_train_integrator)value) : NULL;
}

const char *lg_name_schedule(uint32_t value) {
    return value < LG_SCHEDULE_COUNT ? lg_schedule_name((lg_schedule_kind)value) : NULL;
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
NAMES(family, [LG_HAMILTONIAN_CHAIN] = "chain", [LG_HAMILTONIAN_SEPARABLE] = "separable")
NAMES(potential, [LG_POTENTIAL_MLP] = "mlp", [LG_POTENTIAL_LINEAR] = "linear")
NAMES(dtype, [LG_F64] = "f64", [LG_F32] = "f32")
NAMES(penalty_form, [LG_PENALTY_MEAN_SQUARE] = "text", [LG_PENALTY_SUM_ABSOLUTE] = "published")
NAMES(values, [false] = "discrete", [true] = "continuous")
NAMES(truth, [false] = "false", [true] = "true")
NAMES(yes, [false] = "no", [true] = "yes")
NAMES(noise, [LG_NOISE_NORMAL] = "normal", [LG_NOISE_UNIFORM] = "uniform")

const lg_known_system lg_known_systems[LG_KNOWN_SYSTEMS] = {
    [LG_KNOWN_CHAIN] = {"pendulum-chain", LG_HAMILTONIAN_CHAIN, 0},
    [LG_KNOWN_QUARTIC] = {"quartic", LG_HAMILTONIAN_SEPARABLE, 2},
    [LG_KNOWN_COUPLED] = {"coupled-oscillators", LG_HAMILTONIAN_SEPARABLE, 2},
};

const lg_known_system *lg_find_system(const char *name) {
    for (size_t i = 0; i < LG_KNOWN_SYSTEMS; i++)
        if (strcmp(lg_known_systems[i].name, name) == 0) return &lg_known_systems[i];
    return NULL;
}

void lg_layout_text(lg_hamiltonian_family family, uint32_t links, char text[LG_LAYOUT_TEXT]) {
    size_t used = 0;
    (void)snprintf(text, LG_LAYOUT_TEXT, "q p");
    if (family != LG_HAMILTONIAN_CHAIN) return;
    for (uint32_t i = 1; i <= links && used < LG_LAYOUT_TEXT; i++)
        used += (size_t)snprintf(text + used, LG_LAYOUT_TEXT - used, "%sq%u p%u", i > 1 ? " " : "", i, i);
}

lg_status lg_missing_is_format(lg_status status, lg_error *error) {
    if (status != LG_NOT_FOUND) return status;
    if (error != NULL) error->status = LG_FORMAT;
    return LG_FORMAT;
}
