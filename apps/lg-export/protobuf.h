/* Protocol buffers, as ONNX files are written: fields one behind the other, each with its number. */
#ifndef LG_EXPORT_PROTOBUF_H
#define LG_EXPORT_PROTOBUF_H

#include "lg-export/export.h"

void proto_whole(text *to, int field, int64_t value);
void proto_bytes(text *to, int field, const void *data, size_t length);
void proto_text(text *to, int field, const char *value);
/* The message becomes a field, and is emptied. */
void proto_message(text *to, int field, text *message);

#endif
