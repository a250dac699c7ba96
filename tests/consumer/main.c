/* What a C program outside the tree sees of the library. */
#include <stdio.h>
#include <string.h>

#include <liegrad/context.h>

int main(void) {
    lg_context *context = NULL;
    lg_status status = lg_context_create(NULL, &context);
    printf("C: liegrad %s, %s\n", lg_version(), lg_status_name(status));
    lg_context_destroy(context);
    return status == LG_OK && strcmp(lg_status_name(LG_SHAPE), "SHAPE") == 0 ? 0 : 1;
}
