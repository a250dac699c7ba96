/* lg-anomaly: classifies windows of sensor data, and watches a feed. */
#include "lg-anomaly/anomaly.h"

APP_PROGRAM(lg_anomaly) {
    app_command commands[7] = {
        anomaly_generate_command, anomaly_feed_command,  anomaly_train_command, anomaly_evaluate_command,
        anomaly_search_command,   anomaly_watch_command, {.run = NULL}};
    return app_main(argc, argv, "lg-anomaly",
                    "Detects damage in series of sensor data. Simulates data of an intact and a broken "
                    "subsea well, trains networks and classical classifiers on them or on your own labelled "
                    "data, and watches a feed.",
                    commands);
}
