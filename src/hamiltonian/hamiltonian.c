/* Learned Hamiltonians: description and initialisation. */
#include <math.h>

#include "hamiltonian/internal.h"
#include "liegrad/geometry.h"

lg_status lg_hamiltonian_space(const lg_hamiltonian_family *family, uint32_t n, lg_space *space) {
    LG_NEEDS(NULL, family, space);
    lg_space_factor factors[LG_HAMILTONIAN_MAX_FACTORS];
    for (uint32_t i = 0; i < family->factors; i++)
        factors[i] = (lg_space_factor){family->factor[i], (family->each[i] > 0 ? family->each[i] : 1) * n};
    return lg_space_init(space, factors, family->factors);
}

lg_space lg_hamiltonian_space_of(const lg_hamiltonian_family *family, uint32_t n) {
    lg_space space = {0};
    (void)lg_hamiltonian_space(family, n, &space);
    return space;
}

lg_space lg_hamiltonian_model_space(const lg_hamiltonian *model) {
    return lg_hamiltonian_space_of(model->family, model->n);
}

/* The larger one of the errors | |q| - 1 | and |q.p| / |p|. */
static double off_sphere(const double *copy) {
    const double *q = copy, *p = copy + 3, along = fabs(lg_dot3(q, p));
    return fmax(fabs(sqrt(lg_dot3(q, q)) - 1), along > 0.0 ? along / sqrt(lg_dot3(p, p)) : 0.0);
}

double lg_hamiltonian_off_manifold(const lg_hamiltonian_family *family, uint32_t n, const double *state,
                                   uint32_t *copy) {
    const lg_space space = lg_hamiltonian_space_of(family, n);
    double most = 0.0;
    for (size_t f = 0; f < space.factors; f++) {
        const lg_space_kind kind = space.factor[f].kind;
        const lg_space_entry *row = lg_space_kind_entry(kind);
        for (uint32_t i = 0; i < space.factor[f].count; i++, state += row->state) {
            const double off = kind == LG_SPACE_TS2 ? off_sphere(state) : row->manifold_error(1, state);
            if (off > most) most = off, *copy = i;
        }
    }
    return most;
}

lg_status lg_hamiltonian_init(lg_hamiltonian *model, const lg_hamiltonian_family *family, uint32_t n,
                              lg_potential_kind potential, const uint32_t *hidden, uint32_t hidden_layers,
                              lg_activation activation) {
    LG_NEEDS(NULL, model, family);
    if (n < 1 || n > lg_hamiltonian_most_copies(family)) return LG_INVALID_ARGUMENT;
    const lg_potential_row *row = lg_potential_row_of(potential);
    if (row == NULL) return LG_INVALID_ARGUMENT;
    lg_hamiltonian made = {
        .family = family, .n = n, .potential = potential, .scales = LG_HAMILTONIAN_NO_SCALES};
    const uint32_t layers = row->layered ? hidden_layers : 0, functions = row->count(family->inputs * n);
    LG_TRY(lg_mlp_init(&made.net, functions, hidden, layers, 1, activation, false));
    *model = made;
    return LG_OK;
}

static size_t array_size(const lg_hamiltonian *model, size_t index) {
    const size_t rank = model->family->arrays[index].rank, m = lg_hamiltonian_array_length(model, index);
    return rank == 0 ? 0 : rank == 1 ? m : m * m;
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
    return (uint32_t)lg_hamiltonian_model_space(model).dim;
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
        if (model->family->usable == NULL || model->family->usable(model->family, model->n, arrays)) return;
    }
}
