/* Writes protocol buffers, the format of ONNX files: fields one behind the other, each with its number. */
#ifndef LG_EXPORT_PROTOBUF_H
#define LG_EXPORT_PROTOBUF_H

#include "lg-export/export.h"

void proto_whole(text *to, int field, int64_t value);
void proto_text(text *to, int field, const char *value);
/* Adds `message` as a field of `to`, then frees the message's text. */
void proto_message(text *to, int field, text *message);

#endif
