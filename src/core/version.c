#include "liegrad/core.h"

const char *lg_version(void) {
    return LG_VERSION_STRING;
}
