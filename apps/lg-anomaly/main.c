/* lg-anomaly: classes of windows of sensor data, and a feed that is watched. */
#include "lg-anomaly/anomaly.h"

int main(int argc, char **argv) {
    app_command commands[7] = {generate_command, feed_command,  train_command, evaluate_command,
                               search_command,   watch_command, {.run = NULL}};
    return app_main(argc, argv, "lg-anomaly",
                    "Detectors of damage in series of sensor data: data of a subsea well intact and broken, "
                    "networks and classical classifiers trained on them or on your own labelled data, and a "
                    "watch over a feed.",
                    commands);
}
