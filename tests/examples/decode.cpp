// All fields of each message as a line of JSON, for the test to compare: lengths and bytes on standard input.
#include <cmath>
#include <iomanip>
#include <iostream>

#include "wrench.hpp"

std::ostream& operator<<(std::ostream& out, const std::optional<double>& value) {
    return value ? out << *value : out << "null";
}

template <typename T>
void list(const char* name, const std::vector<T>& values) {
    std::cout << '"' << name << "\":[";
    for (std::size_t i = 0; i < values.size(); i++) {
        std::cout << (i ? "," : "");
        if (std::isnan(static_cast<double>(values[i]))) std::cout << "NaN";
        else std::cout << +values[i];
    }
    std::cout << "],";
}

int main() {
    std::cout << std::setprecision(17);
    std::uint32_t lengths[2];
    while (std::cin.read(reinterpret_cast<char*>(lengths), sizeof lengths)) {
        std::string encoding(lengths[0], '\0'), payload(lengths[1], '\0');
        std::cin.read(encoding.data(), lengths[0]);
        std::cin.read(payload.data(), lengths[1]);
        try {
            const auto w = insole::decode_wrench(payload.data(), payload.size(), encoding);
            std::cout << "{\"foot\":\"" << w.foot << "\",\"seq\":" << w.seq << ",\"started_ns\":" << w.started_ns
                      << ",\"t_ns\":" << w.t_ns << ",\"t_published_ns\":" << w.t_published_ns
                      << ",\"n_triangles\":" << w.n_triangles << ",\"f_z_n\":" << w.f_z_n << ",\"m_x_nm\":" << w.m_x_nm
                      << ",\"m_y_nm\":" << w.m_y_nm << ",\"cop_x_m\":" << w.cop_x_m << ",\"cop_y_m\":" << w.cop_y_m
                      << ",\"f_z_std_n\":" << w.f_z_std_n << ",\"m_x_std_nm\":" << w.m_x_std_nm
                      << ",\"m_y_std_nm\":" << w.m_y_std_nm << ",\"contact_area_m2\":" << w.contact_area_m2
                      << ",\"valid_fraction\":" << w.valid_fraction << ',';
            list("valid", w.valid);
            list("age_ms", w.age_ms);
            list("missing", w.missing);
            std::cout << "\"repeated\":" << (w.repeated ? "true" : "false") << ",\"model\":\"" << w.model
                      << "\",\"beyond_fraction\":" << w.beyond_fraction << "}\n";
        } catch (const std::exception& error) {
            std::cout << "{\"error\":\"" << error.what() << "\"}\n";
        }
    }
}
