//! `braid-ecs plugins`: everything that a scene may name in this program.
use super::message::{Failure, out};
use crate::catalog::Group;
use crate::simulation::{Plugin, Simulation};
use clap::Args;

/// Arguments of the list.
#[derive(Args, Debug)]
pub(super) struct PluginsArgs {
    /// Print the list as JSON.
    #[arg(long)]
    json: bool,
}

/// Prints every name with its sentence, group by group.
pub(super) fn list(args: &PluginsArgs, plugins: impl Plugin) -> Result<(), Failure> {
    let all = Simulation::new(|sim: &mut Simulation| plugins.build(sim)).registry.catalog();
    if args.json {
        out(&serde_json::to_string_pretty(&all).expect("texts only"));
        return Ok(());
    }
    let width = all.iter().map(|e| e.name.chars().count()).max().unwrap_or(0);
    for (n, group) in Group::ALL.into_iter().enumerate() {
        out(&format!("{}{}", if n > 0 { "\n" } else { "" }, group.title()));
        for e in all.iter().filter(|e| e.group == group) {
            out(&format!("  {:<width$}  {}", e.name, e.about));
        }
    }
    Ok(())
}
