/* Starts of scenes. */
#include "common/app.h"
#include "liegrad/io.h"

int app_scene_start(const app *self, lg_scene *scene, const char *path) {
    if (scene->has_initial) return APP_EXIT_OK;
    const lg_status status = lg_scene_draw_start(scene, self->seed);
    if (status == LG_UNSUPPORTED)
        return app_fail(
            self, LG_FORMAT,
            "%s: there is no start: the key `initial` is missing, and starts are drawn on R^n and "
            "for chains in the form hamiltonian only",
            path);
    if (status != LG_OK) return app_fail(self, status, "%s: %s", path, lg_status_sentence(status));
    app_warn(self, "%s: there is no `initial`: the start is drawn with seed %llu", path,
             (unsigned long long)self->seed);
    return APP_EXIT_OK;
}
