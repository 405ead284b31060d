// A stand-in, not Zenoh: the few declarations of zenoh-c 1.x that docs/examples/subscriber.cpp uses, with the signatures
// of its headers, so that a compiler sees the whole example where there is no zenoh-c. What a subscriber would receive
// is read from the file named by STAND_IN_SAMPLES: for each sample the lengths of encoding and payload, each as 4 bytes,
// and then both.
#pragma once
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <string>

typedef int8_t z_result_t;
#define Z_CONFIG_MODE_KEY "mode"
#define Z_CONFIG_CONNECT_KEY "connect/endpoints"

#define STAND_IN_OWNED(name)                                                                        \
    struct z_loaned_##name##_t { std::string bytes; };                                              \
    struct z_owned_##name##_t { z_loaned_##name##_t is; };                                          \
    struct z_moved_##name##_t { z_owned_##name##_t is; };                                           \
    inline const z_loaned_##name##_t* z_loan(const z_owned_##name##_t& of) { return &of.is; }       \
    inline z_loaned_##name##_t* z_loan_mut(z_owned_##name##_t& of) { return &of.is; }               \
    inline z_moved_##name##_t* z_move(z_owned_##name##_t& of) { return reinterpret_cast<z_moved_##name##_t*>(&of); } \
    inline void z_drop(z_moved_##name##_t*) {}
STAND_IN_OWNED(config)
STAND_IN_OWNED(session)
STAND_IN_OWNED(slice)
STAND_IN_OWNED(string)

struct z_loaned_bytes_t { std::string bytes; };
struct z_loaned_encoding_t { std::string bytes; };
struct z_loaned_sample_t { z_loaned_bytes_t payload; z_loaned_encoding_t encoding; };
struct z_loaned_keyexpr_t { std::string bytes; };
struct z_view_keyexpr_t { z_loaned_keyexpr_t is; };
inline const z_loaned_keyexpr_t* z_loan(const z_view_keyexpr_t& of) { return &of.is; }

struct z_open_options_t;
struct z_subscriber_options_t;
extern "C" using z_closure_drop_callback_t = void(void* context);
extern "C" using z_closure_sample_callback_t = void(z_loaned_sample_t* sample, void* context);
struct z_owned_closure_sample_t { z_closure_sample_callback_t* call; z_closure_drop_callback_t* drop; void* context; };
struct z_moved_closure_sample_t { z_owned_closure_sample_t is; };
inline z_moved_closure_sample_t* z_move(z_owned_closure_sample_t& of) {
    return reinterpret_cast<z_moved_closure_sample_t*>(&of);
}
inline void z_closure(z_owned_closure_sample_t* made, z_closure_sample_callback_t* call, z_closure_drop_callback_t* drop,
                      void* context) {
    *made = {call, drop, context};
}

inline z_result_t z_config_default(z_owned_config_t*) { return 0; }
inline z_result_t zc_config_insert_json5(z_loaned_config_t*, const char* key, const char* value) {
    std::cerr << "a stand-in for Zenoh: " << key << " = " << value << '\n';
    return 0;
}
inline z_result_t z_open(z_owned_session_t*, z_moved_config_t*, const z_open_options_t*) {
    return std::getenv("STAND_IN_SAMPLES") ? 0 : -1;
}
inline z_result_t z_view_keyexpr_from_str(z_view_keyexpr_t* key, const char* text) { return key->is.bytes = text, 0; }

inline const z_loaned_bytes_t* z_sample_payload(const z_loaned_sample_t* sample) { return &sample->payload; }
inline const z_loaned_encoding_t* z_sample_encoding(const z_loaned_sample_t* sample) { return &sample->encoding; }
inline z_result_t z_bytes_to_slice(const z_loaned_bytes_t* from, z_owned_slice_t* to) {
    return new (to) z_owned_slice_t{from->bytes}, 0;
}
inline void z_encoding_to_string(const z_loaned_encoding_t* from, z_owned_string_t* to) {
    new (to) z_owned_string_t{from->bytes};
}
inline const uint8_t* z_slice_data(const z_loaned_slice_t* of) {
    return reinterpret_cast<const uint8_t*>(of->bytes.data());
}
inline size_t z_slice_len(const z_loaned_slice_t* of) { return of->bytes.size(); }
inline const char* z_string_data(const z_loaned_string_t* of) { return of->bytes.data(); }
inline size_t z_string_len(const z_loaned_string_t* of) { return of->bytes.size(); }

inline z_result_t z_declare_background_subscriber(const z_loaned_session_t*, const z_loaned_keyexpr_t* key,
                                                  z_moved_closure_sample_t* closure, z_subscriber_options_t*) {
    std::cerr << "a stand-in for Zenoh: subscribed to " << key->bytes << '\n';
    std::ifstream samples(std::getenv("STAND_IN_SAMPLES"), std::ios::binary);
    uint32_t lengths[2];
    while (samples.read(reinterpret_cast<char*>(lengths), sizeof lengths)) {
        z_loaned_sample_t sample{{std::string(lengths[1], '\0')}, {std::string(lengths[0], '\0')}};
        samples.read(sample.encoding.bytes.data(), lengths[0]);
        samples.read(sample.payload.bytes.data(), lengths[1]);
        closure->is.call(&sample, closure->is.context);
    }
    return 0;
}
