"""For each command an example that runs in an empty folder; its help ends with it."""

_HOUSE = "slowtime demo --duration 30 --data house --record house.mcap"
_RECORD = "slowtime simulate --structure tower --epochs 25 --seed 1 --out tower.mcap"
_MODES = f"{_RECORD} && slowtime identify tower.mcap --window-s 60 --hop-s 60 --out modes.json"

EXAMPLES: dict[str, str] = {
    "demo": "slowtime demo --duration 30",
    "edge": f"{_RECORD} && slowtime edge --file tower.mcap --speed 0",
    "twin": "slowtime router & slowtime twin",
    "router": "slowtime router",
    "keys": "slowtime keys make lab --asset beam && slowtime keys list",
    "tokens": "slowtime tokens add ann --scope viewer --site lab && slowtime tokens list",
    "twin quarantine": "slowtime demo --duration 60 & sleep 25; "
    "slowtime twin quarantine list demo.tower; kill %1",
    "twin alarms": "slowtime demo --duration 60 & sleep 25; "
    "slowtime twin alarms deliveries demo.tower; kill %1",
    "twin holdings": "slowtime demo --duration 60 & sleep 25; slowtime twin holdings list; "
    "kill %1",
    "twin outputs": """echo '{"outputs": {"a": {"kind": "mqtt", "host": "127.0.0.1"}}}' """
    "> outputs.json; slowtime demo --duration 60 & sleep 25; "
    "slowtime twin outputs outputs.json & sleep 10; kill %2 %1",
    "twin event": "slowtime demo --duration 60 & sleep 25; "
    "slowtime twin event add demo.tower --kind note --text Inspected; "
    "slowtime twin event list demo.tower; kill %1",
    "router status": "slowtime router & sleep 5; slowtime router status; kill %1",
    "plugins": "slowtime plugins",
    "doctor": "slowtime doctor",
    "completion": "slowtime completion bash > slowtime.bash && . ./slowtime.bash",
    "db check": f"{_HOUSE} && slowtime db check house/twin.sqlite",
    "db ledger": f"{_HOUSE} && slowtime db ledger verify house.mcap --key house/ledger.pem.pub",
    "twin composite": "echo '{members: [demo.tower]}' > yard.yaml; slowtime demo --duration "
    "60 & sleep 25; slowtime twin composite add yard.yaml --id demo.yard; slowtime twin "
    "composite list; kill %1",
    "db backup": f"{_HOUSE} && slowtime db backup house/twin.sqlite --out monday.sqlite",
    "db restore": f"{_HOUSE} && slowtime db backup house/twin.sqlite --out monday.sqlite && "
    "slowtime db restore monday.sqlite --database house/twin.sqlite",
    "export": f"{_HOUSE} && slowtime export house/twin.sqlite --asset demo.tower --out a.csv",
    "record": "slowtime router & sleep 5; "
    "slowtime record --out house.mcap --duration 5; kill %1",
    "replay": f"{_HOUSE} && slowtime replay house.mcap --into again.sqlite",
    "mcap recover": f"{_RECORD} && head -c 100000 tower.mcap > torn.mcap; "
    "slowtime mcap recover torn.mcap --out sound.mcap",
    "mcap layout": f"{_HOUSE} && slowtime mcap layout house.mcap --out house.json",
    "import": "seq 2000 | awk '{print sin($1 * 0.3)}' > record.csv && "
    "slowtime import record.csv --rate-hz 100 --out record.mcap",
    "identify": f"{_RECORD} && slowtime identify tower.mcap",
    "simulate": _RECORD,
    "modes distortion": """awk 'BEGIN {print "t_s,angle"; for (i = 0; i < 2000; i++) """
    """print i / 50 """
    """"," exp(-i / 800) * cos(i / 7)}' > swing.csv && """
    "slowtime modes distortion swing.csv --decay --output angle",
    "publish": "slowtime publish --to - --setting seconds=2",
    "diagnose": "(echo slow_time,frequency_hz,frequency_sd,temperature_c; seq 200 | "
    """awk '{print $1 "," 4 - 0.03 * sin($1 / 20) + 0.007 * (rand() - 0.5) ",0.002," """
    """10 * sin($1 / 20)}') > bridge.csv && """
    "slowtime diagnose --history bridge.csv --out found",
    "twin evolve": f"{_MODES} && slowtime twin evolve modes.json --nominal-hz 5",
    "twin forecast": f"{_MODES} && slowtime twin forecast modes.json --nominal-hz 5 "
    "--threshold -0.1",
    "twin plan": f"{_MODES} && echo "
    """'{"lab.tower": {"nominal": {"frequency_hz": 5, "damping_ratio": 0.01}, "costs": """
    """{"failure": 9e5, "repair": 4e4, "inspection": 1500, "time_unit": "slow_time"}, """
    """"decision": {"failure": {"quantity": "stiffness_change", "below": -0.3}, """
    """"horizon": 600}}}' > twins.json && slowtime twin plan modes.json """
    "--registration twins.json",
    "twin risk": f"{_MODES} && echo "
    """'{"lab.tower": {"nominal": {"frequency_hz": 5, "damping_ratio": 0.01}, """
    """"limit_states": [{"kind": "threshold", "name": "30 % softer", "quantity": """
    """"stiffness_change", "below": -0.3}]}}' > twins.json && """
    "slowtime twin risk modes.json --registration twins.json",
    "twin whatif": f"{_MODES} && slowtime twin whatif modes.json --nominal-hz 5 "
    "--nominal-damping 0.01 "
    "--load step --amplitude 1",
    "reliability": """echo '{slowtime_reliability: 1, inputs: {"""
    "r: {marginal: lognormal, mean: 10, sd: 1}, s: {marginal: gumbel, mean: 5, sd: 1}}, "
    """limit_state: r - s}' > beam.yaml && slowtime reliability beam.yaml""",
    "modes merge": "slowtime simulate --structure frame --epochs 1 --seed 1 --out frame.mcap "
    "&& slowtime identify frame.mcap --method modes --out a.json && cp a.json b.json && "
    "slowtime modes merge a.json b.json",
    "modes track": """echo '{slowtime_model: 1, name: rig, nodes: [{id: m, mass_kg: 2}], """
    "elements: [{id: k, between: [base, m], stiffness_n_per_m: 900, damping_n_s_per_m: 1}], "
    "inputs: [{channel: f, kind: force, node: m, unit: N}], sensors: [{channel: a, quantity: "
    """acceleration, node: m, unit: m/s^2}]}' > rig.yaml && awk 'BEGIN {print "t_s,f,a"; """
    "for (i = 0; i < 20000; i++) {f = sin(i * i / 4e6); a = (f - 800 * x - v) / 2; "
    """if (i % 10 == 0) print i / 1000 "," f "," a; v += a / 1000; x += v / 1000}}' > a.csv """
    "&& slowtime modes track rig.yaml a.csv",
    "twin separate": 'seq 0 99 | awk \'BEGIN {print "slow_time,value,sd"} '
    '{print $1 "," 4 - 0.002 * $1 + 0.05 * sin($1) ",0.01"}\' > history.csv && '
    "slowtime twin separate history.csv",
    "surrogate": 'seq 60 | awk \'BEGIN {print "mass,stiffness,peak"} {m = 1 + rand(); '
    'k = 2 + rand(); print m "," k "," sqrt(k / m)}\' > runs.csv && '
    "slowtime surrogate runs.csv --output peak",
    "design": """echo '{slowtime_design: 1, variables: {area: {lower: 1, upper: 9}}, """
    "inputs: {load: {marginal: gumbel, mean: 5, sd: 1}}, objective: {formula: area}, "
    """limit_states: {yielding: {formula: 3 * area - load, probability: 0.001}}}' > rod.yaml """
    "&& slowtime design rod.yaml",
    "model effects": "slowtime model effects coulomb",
    "fatigue": "seq 20000 | awk '{print 50 * sin($1 * 0.3) + 20 * sin($1 * 0.07)}' > s.csv && "
    "slowtime fatigue s.csv --rate-hz 100 --detail-category 71",
    "virtual": """echo '{slowtime_model: 1, nodes: [{id: m, mass_kg: 100}], elements: """
    """[{id: k, between: [base, m], stiffness_n_per_m: 1e5, damping_n_s_per_m: 60}], """
    """sensors: [{channel: a, quantity: acceleration, node: m, unit: m/s^2, """
    """noise_sd: 0.01}], tolerance: {stiffness: 0.05}}' > one.yaml && """
    """slowtime simulate --model one.yaml --rate-hz 100 --duration 60 --seed 1 """
    """--noise --setting force_psd=100 --out a.npz && """
    "slowtime virtual one.yaml a.npz --quantity force --element k",
}
_CHAIN = (
    """seq 12 | awk '{print $1, $1, 2e6; if ($1 > 1) print $1 - 1, $1, -1e6}' > k.sti && """
    """seq 6 | awk '{print $1, $1, ($1 < 6 ? 2e6 : 1e6); """
    """if ($1 > 1) print $1 - 1, $1, -1e6}' > low.sti && """
    """seq 12 | awk '{print $1, $1, 100}' > m.mas && """
    """seq 12 | awk 'BEGIN {print "node,direction"} {print $1 ",ux"}' > dofs.csv && """
    """echo '{slowtime_model: 2, matrices: {stiffness: k.sti, mass: m.mas, dofs: dofs.csv, """
    """parameters: [{name: lower half, stiffness: low.sti}]}}' > chain.yaml"""
)
EXAMPLES |= {
    "model update": f"{_CHAIN} && "
    """echo '{"slowtime_modes": 1, "record": "a.csv", "rate_hz": 50, "channels": ["a"], """
    """"duration_s": 600, "assumptions": [], "modes": [{"frequency_hz": {"value": 3.8, """
    """"sd": 0.01}, "damping_ratio": {"value": 0.01, "sd": 0.001}, "correlation": 0, """
    """"shape": null, "kind": "structural", "quality": 1, "snr_db": null, """
    """"method": "modes", "span_s": [0, 600], "flags": []}]}' > modes.json && """
    "slowtime model update chain.yaml modes.json",
    "assess": f"{_CHAIN} && slowtime assess chain.yaml --modes 4",
    "model convert": "printf 'GRID,1,,0.,0.,0.\\nGRID,2,,2.,0.,0.\\nCBAR,1,1,1,2,0.,1.,0.\\n"
    "PBAR,1,1,.01,8.3-6,8.3-6,1.4-5\\nMAT1,1,2.1+11,,.3,7850.\\nSPC1,1,123456,1\\n' > "
    "beam.bdf && slowtime model convert beam.bdf --out beam.yaml && "
    "slowtime model reduce beam.yaml --modes 3",
    "model reduce": f"{_CHAIN} && slowtime model reduce chain.yaml --modes 3",
    "modes orders": """awk 'BEGIN {print "t_s,pulse,a"; for (i = 0; i < 20000; i++) """
    """{t = i / 1000; n = 10 * t + t * t / 4; p = cos(6.2831853 * n); print t "," """
    """(p > 0.9) "," 2 * cos(6.2831853 * n - 1)}}' > runup.csv && """
    "slowtime modes orders runup.csv --tacho pulse --orders 1,2",
    "modes scale": """echo '{slowtime_model: 1, nodes: [{id: m, mass_kg: 90}, """
    """{id: n, mass_kg: 80}], elements: [{id: j, between: [base, m], """
    """stiffness_n_per_m: 3e4, damping_n_s_per_m: 30}, {id: k, between: [m, n], """
    """stiffness_n_per_m: 3e4, damping_n_s_per_m: 30}], sensors: [{channel: a, quantity: """
    """acceleration, node: m, unit: m/s^2}, {channel: b, quantity: acceleration, node: n, """
    """unit: m/s^2}]}' > bare.yaml && """
    "sed 's/mass_kg: 80/mass_kg: 88/' bare.yaml > more.yaml && "
    "slowtime simulate --model bare.yaml --rate-hz 20 --duration 900 --seed 1 "
    "--out bare.npz && "
    "slowtime simulate --model more.yaml --rate-hz 20 --duration 900 --seed 2 "
    "--out more.npz && "
    "slowtime identify bare.npz --method modes --out bare.json && "
    "slowtime identify more.npz --method modes --out more.json && "
    "slowtime modes scale bare.json --added more.json b=8",
    "model fmu": """echo '{slowtime_model: 1, name: rig, nodes: [{id: m, mass_kg: 2}], """
    "elements: [{id: k, between: [base, m], stiffness_n_per_m: 900, damping_n_s_per_m: 1}], "
    "inputs: [{channel: f, kind: force, node: m, unit: N}], sensors: [{channel: a, quantity: "
    """acceleration, node: m, unit: m/s^2}]}' > rig.yaml && """
    "slowtime model fmu rig.yaml --out rig.fmu",
    "model place": f"{_CHAIN} && slowtime model place chain.yaml --sensors 3 --modes 3",
}
EXAMPLES |= {
    "twin run": EXAMPLES["twin"],
    "router run": EXAMPLES["router"],
    "modes": EXAMPLES["modes merge"],
    "model": EXAMPLES["model reduce"],
    "db": EXAMPLES["db check"],
    "mcap": EXAMPLES["mcap recover"],
}
FIRST_EXAMPLE = f"{_RECORD} && slowtime identify tower.mcap"
ENDLESS_VERBS = ("twin", "twin run", "router", "router run")
"""Those whose line goes on until Ctrl-C."""

HEADING = "Try it in an empty folder:"


def with_example(epilog: str | None, line: str) -> str:
    r"""End a help with a line to paste, each of its commands in a line of its own.

    Examples
    --------
    >>> with_example("Well.", "slowtime a && slowtime b").split()[-6:]
    ['slowtime', 'a', '&&', '\\', 'slowtime', 'b']
    """
    pasted = line.replace(" && ", " && \\\n    ").replace("; slowtime", ";\n  slowtime")
    return f"{(epilog or '').rstrip()}\n\n\b\n{HEADING}\n  {pasted}\n"
