#![allow(missing_docs, clippy::all, clippy::print_stdout)]
use mishandle_rollout::*;
use mishandle_tasks::*;
use std::sync::Arc;
fn main() {
    let name = std::env::args().nth(1).unwrap();
    let n: usize = std::env::args().nth(2).unwrap().parse().unwrap();
    let task = task(&name).unwrap();
    let env = Arc::new(TaskEnvironment::new(task, Preset::Paper, Reward::Shaped).unwrap());
    let sub: usize = std::env::args().nth(3).map_or(task.definition().n_substeps, |s| s.parse().unwrap());
    let env = if sub != task.definition().n_substeps { Arc::new(TaskEnvironment::with_substeps(task, Preset::Paper, Reward::Shaped, sub).unwrap()) } else { env };
    let spec = task.definition().paper.specification().unwrap();
    let mut r = Rollout::new(env.clone(), task.expert().unwrap(), spec, Noise { action_std: std::env::var("NOISE").map_or(0.0, |s| s.parse().unwrap()), observation_std: 0.0 }).unwrap();
    let reqs: Vec<_> = (0..n as u64).map(|i| Request { x0: env.initial_box().sample(Seed(1), i), seed: Seed(1).child(i) }).collect();
    let t = std::time::Instant::now();
    let eps = r.rollout(&reqs).unwrap();
    println!("{} steps/s", (n * 300) as f64 / t.elapsed().as_secs_f64());
    if n <= 3 {
        for e in &eps {
            println!("x0 {:?} end {:?} reward {}", e.x0, e.end, e.total_reward);
            for k in (0..301).step_by(10) {
                print!("{k:4} ");
                for i in 0..e.trace.names().len() { print!("{:9.4} ", e.trace.column(i).get(k).copied().unwrap_or(f64::NAN)); }
                println!();
            }
        }
    } else {
        let (mut s, mut st, mut undecided) = (0, 0, 0);
        for e in &eps {
            match e.verdict.success { Some(x) if x > 0.0 => s += 1, None => undecided += 1, _ => println!("fail {:?} {:?}", e.x0, e.verdict) }
            if e.verdict.strict.is_some_and(|x| x > 0.0) { st += 1 } else if n <= 200 { println!("not strict {:?} {:?}", e.x0, e.verdict) }
        }
        println!("success {s} strict {st} undecided {undecided} of {n}");
    }
}
