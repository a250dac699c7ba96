/* The hyperparameters of a learned Hamiltonian. */
#include "liegrad/hamiltonian.h"

#include <stdio.h>
#include <string.h>

#include "core/core.h"
#include "settings/training.h"

static const char *name_integral(uint32_t value) {
    return value < lg_first_integral_count() ? lg_first_integral_at(value)->name : NULL;
}

/* A name of the table, or a path, which has a point or a slash. */
static lg_status parse_integral(const char *text, void *member, lg_error *error) {
    char names[LG_FIELD_TEXT_SIZE] = "";
    const size_t length = strlen(text);
    if (lg_first_integral_find(text) == NULL && strpbrk(text, "./") == NULL) {
        for (uint32_t i = 0; name_integral(i) != NULL; i++) {
            (void)strcat(names, i > 0 ? ", " : "");
            (void)strcat(names, name_integral(i));
        }
        return lg_fail(error, LG_INVALID_ARGUMENT,
                       "'%s' is not a first integral; take %s, or the file of a program, such as integral.h5",
                       text, names);
    }
    if (length >= LG_INTEGRAL_TEXT)
        return lg_fail(error, LG_INVALID_ARGUMENT, "a path of %zu bytes is too long; at most %d are possible",
                       length, LG_INTEGRAL_TEXT - 1);
    memset(member, 0, LG_INTEGRAL_TEXT);
    memcpy(member, text, length);
    return LG_OK;
}

static void show_integral(const void *member, char *text, size_t size) {
    const char *name = member;
    (void)snprintf(text, size, "%s", name[0] != '\0' ? name : name_integral(0));
}

static uint32_t get_hidden(const void *member, double *values) {
    const lg_mlp *net = member;
    const uint32_t count = net->layers > 0 && net->layers <= LG_MLP_MAX_LAYERS ? net->layers - 1 : 0;
    for (uint32_t i = 0; i < count; i++) values[i] = net->width[i + 1];
    return count;
}

static void put_hidden(void *member, const double *values, uint32_t count) {
    lg_mlp *net = member;
    net->layers = count + 1;
    for (uint32_t i = 0; i < count; i++) net->width[i + 1] = (uint32_t)values[i];
}

#define HAMILTONIAN(group, name, type, member, ...)                                                          \
    LG_FIELD(lg_hamiltonian_run, group, name, type, member, __VA_ARGS__)
const lg_field lg_hamiltonian_fields[] = {
    HAMILTONIAN("model", "potential", NAME, model.potential,
                LG_NAMES([LG_POTENTIAL_MLP] = "mlp", [LG_POTENTIAL_LINEAR] = "linear",
                         [LG_POTENTIAL_DICTIONARY] = "dictionary"),
                .usual = true, .value = "mlp", .meaning = "The potential energy"),
    HAMILTONIAN("model", "symmetry", NAME, model.symmetry,
                LG_NAMES([LG_SYMMETRY_NONE] = "none", [LG_SYMMETRY_EVEN] = "even", [LG_SYMMETRY_ODD] = "odd",
                         [LG_SYMMETRY_AXIAL] = "axial", [LG_SYMMETRY_SPHERICAL] = "spherical"),
                .optional = true, .value = "none",
                .meaning =
                    "even: V(-q) = V(q); odd: V(-q) = -V(q); axial: rotations about e3 do not change V; "
                    "spherical: no rotation changes V"),
    ACTIVATION(lg_hamiltonian_run, model.net.activation, "Activation of the hidden layers", REPLACED("tanh")),
    HAMILTONIAN("model", "hidden", WHOLES, model.net, .get = get_hidden, .put = put_hidden, .low = 1,
                .high = 1 << 20, .most = LG_MLP_MAX_LAYERS - 1, REPLACED("100,100,100"), .unit = "W,W,...",
                .usual = true, .meaning = "Widths of the hidden layers of the potential"),
    SCHEME(lg_hamiltonian_run,
           .otherwise = LG_CHOSEN ": the integrator of the family, see lg-hamiltonian --help"),
    SUBSTEPS(lg_hamiltonian_run, "run", U32, .value = "1"),
    HAMILTONIAN("run", "penalty", REAL, penalty, .high = 1e12, .value = "0", .unit = "MU",
                .meaning = "Penalty on the change of a first integral, 0 for none"),
    HAMILTONIAN(
        "run", "penalty_integral", PHRASE, penalty_integral, .parse = parse_integral, .phrase = show_integral,
        .value_name = name_integral, .form = "the file of a program with a function `integral`",
        .optional = true, .value = "oscillator",
        .otherwise = LG_CHOSEN ": oscillator, or the first one that fits the system", .unit = "NAME|FILE",
        .file = LG_FILE_READ, .meaning = "The first integral whose change is penalised"),
    PENALTY_FORM(
        lg_hamiltonian_run, penalty_form,
        LG_NAMES([LG_PENALTY_MEAN_SQUARE] = "text", [LG_PENALTY_SUM_ABSOLUTE] = "published"), .value = "text",
        .meaning = "text: mean of squares over the batch; published: sum of absolute values over the batch"),
    HAMILTONIAN(
        "run", "distance", NAME, distance,
        LG_NAMES([LG_DISTANCE_AMBIENT] = "ambient", [LG_DISTANCE_GEODESIC] = "geodesic"), .optional = true,
        .value = "ambient",
        .meaning =
            "Distance of points in the loss: ambient (Euclidean in R^d) or along geodesics of the manifold"),
    HAMILTONIAN("run", "scaled", FLAG, scaled, LG_NAMES("no", "yes"), .optional = true, REPLACED("no"),
                .meaning =
                    "Scale the potential's last layer before training, towards the forces of the data"),
    HAMILTONIAN(
        "run", "units", NAME, units, LG_NAMES([LG_UNITS_GIVEN] = "given", [LG_UNITS_DATA] = "data"),
        .optional = true, REPLACED("given"),
        .meaning =
            "Units in which training computes and weighs its loss (given: the units of the data; data: "
            "scales of the data, so that the result does not depend on the units)"),
    INITIAL_STATES(lg_hamiltonian_run,
                   "first points, or at estimated points near them, for first points with noise",
                   .optional = true, .value = "measured"),
    TRAINING_ROWS(lg_hamiltonian_run, "method", squares, "Trajectories", 0, REPLACED, REPLACED),
    VALIDATION(lg_hamiltonian_run, .usual = true, .value = "0"),
    LG_FIELD_END};
