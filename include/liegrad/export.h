/* Symbols marked LG_API are the public interface; everything else is hidden. */
#ifndef LIEGRAD_EXPORT_H
#define LIEGRAD_EXPORT_H

#if defined(__GNUC__) && !defined(LG_STATIC)
#define LG_API __attribute__((visibility("default")))
#else
#define LG_API
#endif

#ifdef __cplusplus
#define LG_BEGIN_DECLS extern "C" {
#define LG_END_DECLS   }
#else
#define LG_BEGIN_DECLS
#define LG_END_DECLS
#endif

#endif
