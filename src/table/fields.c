/* Hyperparameters of the recipe `table`: network and training. */
#include "liegrad/table.h"

#include "settings/training.h"

static uint32_t get_widths(const void *member, double *values) {
    const lg_table_options *o = member;
    const uint32_t count = o->hidden_count < LG_TABLE_LAYERS ? o->hidden_count : LG_TABLE_LAYERS;
    for (uint32_t i = 0; i < count; i++) values[i] = o->hidden[i];
    return count;
}

static void put_widths(void *member, const double *values, uint32_t count) {
    lg_table_options *o = member;
    o->hidden_count = count;
    for (uint32_t i = 0; i < count; i++) o->hidden[i] = (uint32_t)values[i];
}

static uint32_t get_decay(const void *member, double *values) {
    const lg_table_decay *decay = member;
    for (uint32_t i = 0; i < decay->count; i++) values[i] = decay->value[i];
    return decay->count;
}

static void put_decay(void *member, const double *values, uint32_t count) {
    lg_table_decay *decay = member;
    decay->count = count;
    for (uint32_t i = 0; i < count; i++) decay->value[i] = values[i];
}

#define TABLE(group, name, type, member, ...) LG_FIELD(lg_table_run, group, name, type, member, __VA_ARGS__)
const lg_field lg_table_fields[] = {
    TABLE("model", "network", NAME, model.options.network, .value_name = lg_name_net, .value = "mlp",
          .meaning = "Architecture of the network"),
    TABLE("model", "activation", NAME, model.options.activation, .value_name = lg_name_activation,
          .value = "tanh", .meaning = "Activation of the hidden layers"),
    TABLE("model", "hidden", WHOLES, model.options, .get = get_widths, .put = put_widths, .low = 1,
          .high = 1 << 20, .most = LG_TABLE_LAYERS,
          .otherwise =
              LG_CHOSEN ": one layer, whose width the evidence of the data decides; 32 for a classification; "
                        "with Adam or a given weight decay, numbers of rows and columns decide",
          .unit = "W,W,...",
          .meaning = "Widths of the hidden layers, all equal; the first one reads the inputs"),
    TABLE("model", "linear", FLAG, model.options.linear, .value_name = lg_name_truth, .value = "true",
          .meaning = "A linear map of the inputs is added to the network"),
    TABLE("run", "decay", REALS, decay, .get = get_decay, .put = put_decay, .high = 1e12,
          .most = LG_TABLE_SLICES,
          .otherwise = LG_CHOSEN
          ": by the evidence of the data; none for a classification, or where --weight-decay or "
          "--prior is given",
          .unit = "D,D,...",
          .meaning = "Weights D/2 of the squares of each array of parameters, in the order of the arrays in "
                     "the model file"),
    TRAINING_ROWS(lg_table_run, "method", squares, "Rows", 0, PRESET, PRESET),
    TRAINING(lg_table_run, validation, REAL, .otherwise = LG_CHOSEN ": 0.1; 0 with --test, for a regression",
             VALIDATION),
    LG_FIELD_END};
