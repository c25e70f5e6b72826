//! The program `braid-ecs` with the first-party systems.
fn main() -> std::process::ExitCode {
    braid_ecs::cli::main(braid_ecs::systems::default_plugins)
}
