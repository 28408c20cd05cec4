// What a page with roslib does on a stage, and what it hears: node page.mjs ROSLIB URL MAP.json
//
// Each thing that is done prints one line of JSON, for test_roslibjs.py to judge.
import { readFileSync } from "node:fs";

const [module, url, map] = process.argv.slice(2);
const { Action, ActionClient, Goal, Ros, Service, Topic } = await import(module);

const tell = (what, values) => console.log(JSON.stringify([what, values]));
const ros = new Ros({ url });
await new Promise((resolve, reject) => {
  ros.on("connection", resolve);
  ros.on("error", reject);
});

const call = (name, type, request) =>
  new Promise((resolve) => {
    const service = new Service({ ros, name, serviceType: type });
    service.callService(request, (reply) => resolve(reply), (error) => resolve({ error: String(error) }));
  });
const world = (name, request) => call(`/unreal/${name}`, `world_control_msgs/${name}`, request);

tell("services", await new Promise((resolve) => ros.getServices(resolve)));
tell("topics", await new Promise((resolve) => ros.getTopics(resolve)));
tell("spawned", await world("spawn_semantic_map", JSON.parse(readFileSync(map, "utf-8"))));

const pose = { position: { x: 1, y: 2, z: 3 }, orientation: { x: 0, y: 0, z: 0.6, w: 0.8 } };
tell("set", await world("set_model_pose", { id: "milk_carton_1", pose }));
tell("got", await world("get_model_pose", { id: "milk_carton_1" }));
tell("refused", await world("get_model_pose", { id: "nobody" }));
tell("malformed", await world("get_model_pose", { id: 7 }));
tell("lit", await world("highlight_models", { id: "fridge", color: 2 }));
tell("asked", await call("/mindstage/storage_place", "mindstage_msgs/Ask", { args: '{"item": "CowsMilk"}' }));

for (const compression of ["none", "png", "cbor"]) {
  const tf = new Topic({ ros, name: "/tf", messageType: "tf2_msgs/TFMessage", compression });
  tell(`tf ${compression}`, await new Promise((resolve) => tf.subscribe(resolve)));
  tf.unsubscribe();
}
// roslib joins pieces, but has no word to ask for them.
const pieces = { topic: "/tf", id: "pieces", fragment_size: 1000 };
const whole = new Promise((resolve) => ros.once("/tf", ({ msg }) => resolve(msg)));
ros.callOnConnection({ op: "subscribe", ...pieces });
tell("tf pieces", await whole);
ros.callOnConnection({ op: "unsubscribe", ...pieces });

const markers = new Topic({ ros, name: "/unreal/markers", messageType: "visualization_msgs/MarkerArray" });
markers.publish({ markers: [{ ns: "page", id: 1, type: 2, color: { r: 1, g: 0, b: 0, a: 1 } }] });

// The way of ROS 2: one goal that is reached, one that is given up after it told twice how it goes.
const steps = new Action({ ros, name: "/unreal/simulate_steps", actionType: "simulation_interfaces/SimulateSteps" });
const reach = (goal, onFeedback) =>
  new Promise((resolve) => {
    let id;
    const failed = (error) => resolve({ failed: error });
    id = steps.sendGoal(goal, (result) => resolve({ result }), (feedback) => onFeedback(feedback, () => steps.cancelGoal(id)), failed);
  });
tell("reached", await reach({ steps: 50 }, () => {}));
let told = 0;
tell("given up", await reach({ steps: 1e9 }, (_, cancel) => (told += 1) === 2 && cancel()));

// The way of ROS 1, by five topics.
const client = new ActionClient({
  ros,
  serverName: "/unreal/simulate_steps",
  actionName: "simulation_interfaces/SimulateStepsAction",
});
const goal = new Goal({ actionClient: client, goalMessage: { steps: 1e9 } });
const preempted = new Promise((resolve) => {
  goal.on("result", (result) => resolve({ result, status: goal.status.status }));
});
await new Promise((resolve) => {
  goal.on("feedback", resolve);
  goal.send();
});
goal.cancel();
tell("preempted", await preempted);
client.dispose();
ros.close();
