/* The hyperparameters of a fault detector. */
#include "liegrad/anomaly.h"

#include "anomaly/judge.h"

/* Value of .methods for fields that apply to the network only. The network's validation part is drawn by the
 * field validation_fraction, so that recordings and groups stay whole; therefore lg_fit's setting
 * `validation` is no field and stays 0. */
enum { NETWORK = 1 };

#define DETECTOR(group, name, type, member, ...)                                                             \
    LG_FIELD(lg_detector_run, group, name, type, member, __VA_ARGS__)
const lg_field lg_detector_fields[] = {
    DETECTOR("model", "plane", U32, model.net.plane, .high = 1 << 20, .value = "2", .unit = "n",
             .methods = NETWORK,
             .meaning = "cnn: width of the layer before the output, 0 for none; 2 can be drawn"),
    ACTIVATION(lg_detector_run, model.net.activation, "cnn: activation of all layers", PRESET(),
               .methods = NETWORK),
    DETECTOR("model", "loss", NAME, model.loss, LG_NAMED(lg_detector_loss_name, LG_DETECTOR_LOSS_COUNT),
             .otherwise = LG_OF_PRESET, .methods = NETWORK,
             .meaning = "cnn: loss function; mse is for two classes"),
    DETECTOR(
        "model", "centred", FLAG, model.centred, LG_NAMES("no", "yes"), .value = "no", .methods = NETWORK,
        .meaning = "cnn: subtract each window's mean from its channels, so that the network learns from the "
                   "motion alone"),
    DETECTOR("run", "split", NAME, split, .usual = true, LG_NAMED(lg_split_name, LG_SPLIT_COUNT),
             .value = "random",
             .meaning = "Units of the split: random (single windows), run (recordings) or group (such as sea "
                        "states); windows of one recording resemble each other, so random gives too good "
                        "figures"),
    HEALTHY(lg_detector_run),
    TEST_FRACTION(lg_detector_run, "Part of the windows for testing", .high = 0.95, .value = "0.2"),
    DETECTOR("run", "validation_fraction", REAL, validation_fraction, PART_FOR_VALIDATION,
             .json = "validation", .value = "0.1", .methods = NETWORK),
    DETECTOR("run", "max_restarts", U32, restarts, .high = 1000, .optional = true, .value = "10", .unit = "n",
             .methods = NETWORK,
             .meaning = "cnn: how often at most a network that died (a layer is constant over all training "
                        "windows) is started again, with other weights from the same seed"),
    TRAINING_ROWS(lg_detector_run, "optimizer", any_loss, "cnn: windows", NETWORK, PRESET, PRESET),
    LG_FIELD_END};
