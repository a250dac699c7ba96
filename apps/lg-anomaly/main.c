/* lg-anomaly: classifies windows of sensor data, and watches a feed. */
#include "lg-anomaly/anomaly.h"

int main(int argc, char **argv) {
    app_command commands[7] = {generate_command, feed_command,  train_command, evaluate_command,
                               search_command,   watch_command, {.run = NULL}};
    return app_main(argc, argv, "lg-anomaly",
                    "Detects damage in series of sensor data. Simulates data of an intact and a broken "
                    "subsea well, trains networks and classical classifiers on them or on your own labelled "
                    "data, and watches a feed.",
                    commands);
}
