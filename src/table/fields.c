/* Hyperparameters of the recipe `table`: network and training. */
#include "liegrad/table.h"

#include "settings/training.h"

#define TABLE(group, name, type, member, ...) LG_FIELD(lg_table_run, group, name, type, member, __VA_ARGS__)
const lg_field lg_table_fields[] = {
    TABLE("model", "network", NAME, model.options.network, .option = "architecture",
          LG_NAMED(lg_net_kind_name, LG_NET_KIND_COUNT), .value = "mlp",
          .meaning = "Architecture of the network"),
    ACTIVATION(lg_table_run, model.options.activation, "Activation of the hidden layers", .value = "tanh"),
    TABLE("model", "hidden", WHOLES, model.options.hidden,
          LG_COUNTED(lg_table_run, model.options.hidden_count), .usual = true, .low = 1, .high = 1 << 20,
          .most = LG_TABLE_LAYERS,
          .otherwise =
              LG_CHOSEN ": one layer, whose width the evidence of the data decides; 32 for a classification; "
                        "with Adam or a given weight decay, numbers of rows and columns decide",
          .unit = "W,W,...",
          .meaning = "Widths of the hidden layers, all equal; the first one reads the inputs"),
    TABLE("model", "linear", FLAG, model.options.linear, LG_NAMES("false", "true"), .value = "true",
          .meaning = "A linear map of the inputs is added to the network"),
    TABLE("run", "decay", REALS, decay.value, LG_COUNTED(lg_table_run, decay.count), .high = 1e12,
          .most = LG_TABLE_SLICES,
          .otherwise = LG_CHOSEN
          ": by the evidence of the data; none for a classification, or where --weight-decay or "
          "--prior is given",
          .unit = "D,D,...",
          .meaning = "Weights D/2 of the squares of each array of parameters, in the order of the arrays in "
                     "the model file"),
    TRAINING_ROWS(lg_table_run, "method", squares, "Rows", 0, PRESET, PRESET),
    VALIDATION(lg_table_run, .otherwise = LG_CHOSEN ": 0.1; 0 with --test, for a regression"),
    LG_FIELD_END};
