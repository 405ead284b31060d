// The message insole.wrench/2 from its bytes, as in protocol/wrench.schema.json. C++17 and msgpack-cxx, no Zenoh.
#pragma once
#include <cstdint>
#include <cstring>
#include <msgpack.hpp>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

namespace insole {

struct Floats : std::vector<float> {  // an array travels as its little-endian bytes, which is how this host has them
    void msgpack_unpack(const msgpack::object& bytes) {
        if (bytes.type != msgpack::type::BIN || bytes.via.bin.size % sizeof(float)) throw msgpack::type_error();
        resize(bytes.via.bin.size / sizeof(float));
        std::memcpy(data(), bytes.via.bin.ptr, bytes.via.bin.size);
    }
};

struct Wrench {
    std::string foot;
    std::uint64_t seq = 0, started_ns = 0, t_ns = 0, t_published_ns = 0, n_triangles = 0;
    std::optional<double> f_z_n, m_x_nm, m_y_nm, cop_x_m, cop_y_m;  // empty: not known, which is not 0
    std::optional<double> f_z_std_n, m_x_std_nm, m_y_std_nm;
    double contact_area_m2 = 0, valid_fraction = 0;
    std::vector<std::uint8_t> valid, missing;  // n_triangles × 12, n_triangles
    Floats age_ms;                             // n_triangles
    bool repeated = false;
    std::string model;  // "static" or "dynamic": whether the calibration's effects are undone
    double beyond_fraction = 0;
    MSGPACK_DEFINE_MAP(foot, seq, started_ns, t_ns, t_published_ns, n_triangles, f_z_n, m_x_nm, m_y_nm, cop_x_m, cop_y_m,
                       f_z_std_n, m_x_std_nm, m_y_std_nm, contact_area_m2, valid_fraction, valid, missing, age_ms, repeated,
                       model, beyond_fraction)
};

inline Wrench decode_wrench(const char* payload, std::size_t size, const std::string& encoding) {
    if (encoding != "application/msgpack;insole.wrench/2") throw std::runtime_error("another message: " + encoding);
    const msgpack::unpack_limit flat(0, 64, 64, size, 0, 1);  // a spoilt length shall not ask for gigabytes
    auto wrench = msgpack::unpack(payload, size, nullptr, nullptr, flat)->as<Wrench>();
    if (wrench.n_triangles == 0 || wrench.valid.size() != wrench.n_triangles * 12 ||
        wrench.missing.size() != wrench.n_triangles || wrench.age_ms.size() != wrench.n_triangles)
        throw std::runtime_error("insole.wrench/2: an array is not as long as n_triangles says");
    return wrench;
}

}  // namespace insole
