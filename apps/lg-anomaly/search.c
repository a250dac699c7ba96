/* lg-anomaly search: random search over the options of train --method cnn. */
#include "common/search.h"

#include "lg-anomaly/train.h"

static int search(app *self, const train_task *task) {
    return search_main(self, &train_command, task);
}

static int run(app *self) {
    return with_task(self, search);
}

const app_command search_command = {
    .name = "search",
    .arguments = "RANGES.yaml DATA.h5",
    .summary = "Random search over the options of train --method cnn",
    .details =
        "The objective is the network's loss on the held-out part at its best epoch.\n\n" SEARCH_DETAILS
        " The search never uses the test part (fixed: test-fraction, split): train the best trial to "
        "evaluate it.",
    .settings = APP_SETTINGS(SEARCH_SHARED),
    .run = run,
    .together = APP_WORKERS};
