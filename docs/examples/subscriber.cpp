// Prints the force of both feet: a subscriber on zenoh-c 1.x. Enter ends it.
//     g++ -std=c++17 subscriber.cpp -lzenohc -o subscriber && ./subscriber tcp/127.0.0.1:7447
#include <iostream>
#include <map>
#include <zenoh.h>

#include "wrench.hpp"

void take(const insole::Wrench& wrench) {
    static std::map<std::string, std::pair<std::uint64_t, std::uint64_t>> next;  // by foot: start of the daemon, seq
    auto& [started_ns, seq] = next[wrench.foot];
    if (started_ns == wrench.started_ns && wrench.seq > seq) std::cout << wrench.seq - seq << " cycles did not reach me\n";
    started_ns = wrench.started_ns, seq = wrench.seq + 1;
    std::cout << wrench.foot << ' ' << wrench.seq << ' ';
    if (wrench.f_z_n) std::cout << *wrench.f_z_n << " N, from " << 100 * wrench.valid_fraction << " % of the insole\n";
    else std::cout << "no valid taxel\n";
}

extern "C" void receive(z_loaned_sample_t* sample, void*) {
    z_owned_slice_t payload;
    z_owned_string_t encoding;
    z_bytes_to_slice(z_sample_payload(sample), &payload);
    z_encoding_to_string(z_sample_encoding(sample), &encoding);
    try {
        take(insole::decode_wrench(reinterpret_cast<const char*>(z_slice_data(z_loan(payload))),
                                   z_slice_len(z_loan(payload)),
                                   {z_string_data(z_loan(encoding)), z_string_len(z_loan(encoding))}));
    } catch (const std::exception& error) {  // nothing may be thrown through Zenoh
        std::cerr << error.what() << '\n';
    }
    z_drop(z_move(payload));
    z_drop(z_move(encoding));
}

int main(int argc, char** argv) {
    const std::string endpoints = std::string("[\"") + (argc > 1 ? argv[1] : "tcp/127.0.0.1:7447") + "\"]";
    z_owned_config_t config;
    z_config_default(&config);
    zc_config_insert_json5(z_loan_mut(config), Z_CONFIG_MODE_KEY, "\"client\"");
    zc_config_insert_json5(z_loan_mut(config), Z_CONFIG_CONNECT_KEY, endpoints.c_str());
    z_owned_session_t session;
    if (z_open(&session, z_move(config), nullptr) < 0) return std::cerr << "nobody answers on " << endpoints << '\n', 1;
    z_view_keyexpr_t key;
    z_view_keyexpr_from_str(&key, "insole/*/*/wrench");
    z_owned_closure_sample_t closure;
    z_closure(&closure, receive, nullptr, nullptr);
    z_declare_background_subscriber(z_loan(session), z_loan(key), z_move(closure), nullptr);
    std::cin.get();
    z_drop(z_move(session));
}
