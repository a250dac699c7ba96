#include <dlfcn.h>
#include <string.h>

#include "core/core.h"

bool lg_plugin_load(const char *library, size_t count, const lg_plugin_function *functions) {
    void *const handle = dlopen(library, RTLD_NOW | RTLD_GLOBAL);
    for (size_t i = 0; handle != NULL && i < count; i++) {
        void *symbol = dlsym(handle, functions[i].name);
        if (symbol == NULL) return false;
        /* C has no cast from an object pointer to a function pointer. */
        memcpy(functions[i].function, &symbol, sizeof symbol);
    }
    return handle != NULL;
}
