/* Learned Hamiltonians: description and initialisation. */
#include "core/core.h"
#include "hamiltonian/internal.h"

lg_status lg_hamiltonian_space(const lg_hamiltonian_family *family, uint32_t n, lg_space *space) {
    LG_NEEDS(NULL, family, space);
    lg_space_factor factors[LG_HAMILTONIAN_MAX_PARTS];
    for (uint32_t i = 0; i < family->factors; i++) factors[i] = (lg_space_factor){family->factor[i], n};
    return lg_space_init(space, factors, family->factors);
}

lg_status lg_hamiltonian_init(lg_hamiltonian *model, const lg_hamiltonian_family *family, uint32_t n,
                              lg_potential_kind potential, const uint32_t *hidden, uint32_t hidden_layers,
                              lg_activation activation) {
    LG_NEEDS(NULL, model, family);
    if (family == NULL || n < 1 || n > LG_HAMILTONIAN_MAX_COPIES) return LG_INVALID_ARGUMENT;
    const lg_potential_row *row = lg_potential_row_of(potential);
    if (row == NULL) return LG_INVALID_ARGUMENT;
    lg_hamiltonian made = {.family = family, .n = n, .potential = potential, .scales = {1.0, {1.0, 1.0}}};
    const uint32_t layers = row->layered ? hidden_layers : 0, functions = row->count(family->inputs * n);
    LG_TRY(lg_mlp_init(&made.net, functions, hidden, layers, 1, activation, false));
    *model = made;
    return LG_OK;
}

static size_t array_size(const lg_hamiltonian *model, size_t index) {
    const uint32_t rank = model->family->arrays[index].rank;
    return rank == 0 ? 0 : rank == 1 ? model->n : (size_t)model->n * model->n;
}

size_t lg_hamiltonian_array_offset(const lg_hamiltonian *model, size_t index) {
    size_t offset = lg_mlp_parameters(&model->net);
    for (size_t i = 0; i < index; i++) offset += array_size(model, i);
    return offset;
}

size_t lg_hamiltonian_parameters(const lg_hamiltonian *model) {
    return lg_hamiltonian_array_offset(model, LG_HAMILTONIAN_MAX_ARRAYS);
}

uint32_t lg_hamiltonian_state_dim(const lg_hamiltonian *model) {
    lg_space space;
    return lg_hamiltonian_space(model->family, model->n, &space) == LG_OK ? (uint32_t)space.dim : 0;
}

uint32_t lg_hamiltonian_input_dim(const lg_hamiltonian *model) {
    return model->family->forces * model->n;
}

enum { DRAWS = 10000 };

void lg_hamiltonian_initialise(const lg_hamiltonian *model, lg_rng *rng, double *theta) {
    double *arrays = theta + lg_hamiltonian_array_offset(model, 0);
    const double *end = theta + lg_hamiltonian_parameters(model);
    lg_mlp_initialise(&model->net, rng, theta);
    for (int draw = 0; draw < DRAWS; draw++) {
        for (double *x = arrays; x < end; x++) *x = lg_rng_uniform(rng);
        if (model->family->usable == NULL || model->family->usable(model->n, arrays)) return;
    }
}
