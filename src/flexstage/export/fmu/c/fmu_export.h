/* Visibility of functions outside a shared library. */
#ifndef FMU_EXPORT_H
#define FMU_EXPORT_H

#if defined _WIN32 || defined __CYGWIN__
#define FMU_EXPORT __declspec(dllexport)
#elif defined __GNUC__ || defined __clang__
#define FMU_EXPORT __attribute__((visibility("default")))
#else
#define FMU_EXPORT
#endif

/* An empty prefix is allowed: then the name stays as it is. */
#define FMU_JOIN_NOW(a, b) a##b
#define FMU_JOIN(a, b) FMU_JOIN_NOW(a, b)

#endif
