#include "lg-export/onnx.h"

#include <string.h>

enum { VARINT = 0, LENGTH = 2 };

static void add_varint(text *to, uint64_t value) {
    char byte;
    for (; value >= 128; value >>= 7) {
        byte = (char)((value & 127) | 128);
        lg_text_append(to, &byte, 1);
    }
    byte = (char)value;
    lg_text_append(to, &byte, 1);
}

static void add_key(text *to, int field, int wire) {
    add_varint(to, (uint64_t)field << 3 | (uint64_t)wire);
}

void proto_whole(text *to, int field, int64_t value) {
    add_key(to, field, VARINT);
    add_varint(to, (uint64_t)value);
}

static void proto_bytes(text *to, int field, const void *data, size_t length) {
    add_key(to, field, LENGTH);
    add_varint(to, length);
    lg_text_append(to, data, length);
}

void proto_text(text *to, int field, const char *value) {
    proto_bytes(to, field, value, strlen(value));
}

void proto_message(text *to, int field, text *message) {
    proto_bytes(to, field, message->data != NULL ? message->data : "", message->length);
    lg_text_destroy(message);
}
