/* Exported detectors with every compiler and optimisation; stack. ctest-labels: study */
#include "export_detector.h"

static const export_kind detectors = {LG_COUNT(samples), detector_name,      detector_way, detector_make,
                                      detector_draw,     detector_reference, NULL};

TEST("every detector is built in every way") {
    export_build_all(&detectors);
}

/* Their loops are long enough for compilers to unroll and to spill. */
TEST("networks of default sizes keep the stated stack") {
    static const struct {
        uint32_t channels, length, classes;
        bool relu;
    } rows[] = {{1, 96, 2, false},  {2, 128, 2, false}, {2, 128, 3, true},  {4, 64, 3, false},
                {6, 100, 2, false}, {6, 100, 3, true},  {6, 300, 5, false}, {6, 300, 2, true}};
    for (size_t i = 0; i < 2 * LG_COUNT(rows); i++) {
        char name[32], command[128];
        (void)snprintf(name, sizeof name, "default%zu", i);
        const sample of = detector_default(name, rows[i / 2].channels, rows[i / 2].length,
                                           rows[i / 2].classes, rows[i / 2].relu);
        detector_save(&of, 0, 0);
        const exported e = export_saved(name, i % 2 == 0 ? "f64" : "f32", 7, NULL);
        export_check_stack(e.folder);
        (void)snprintf(command, sizeof command, "make -C %s test stack", e.folder);
        export_expect(command);
    }
}

TEST_GROUP(export_begin, export_end)
