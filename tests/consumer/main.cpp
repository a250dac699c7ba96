// A C++ program outside the tree that uses the library.
#include <iostream>
#include <string>

#include <liegrad/core.h>

int main() {
    lg_context_options options;
    lg_context_options_init(&options);
    lg_context *context = nullptr;
    const lg_status status = lg_context_create(&options, &context);
    std::cout << "C++: liegrad " << lg_version() << ", " << lg_status_name(status) << "\n";
    lg_context_destroy(context);
    return status == LG_OK && std::string(lg_status_name(LG_SHAPE)) == "SHAPE" ? 0 : 1;
}
