// Uses a simulation by roslibjs: node roslibjs_client.mjs ROSLIB URL MAP.json
//
// Each step prints one line of JSON, which test_roslibjs.py checks.
import { readFileSync } from "node:fs";

const [module, url, map] = process.argv.slice(2);
const { Action, ActionClient, Goal, Ros, Service, Topic } = await import(module);

const print = (what, values) => console.log(JSON.stringify([what, values]));
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

print("services", await new Promise((resolve) => ros.getServices(resolve)));
print("topics", await new Promise((resolve) => ros.getTopics(resolve)));
print("spawned", await world("spawn_semantic_map", JSON.parse(readFileSync(map, "utf-8"))));

const pose = { position: { x: 1, y: 2, z: 3 }, orientation: { x: 0, y: 0, z: 0.6, w: 0.8 } };
print("set pose", await world("set_model_pose", { id: "milk_carton_1", pose }));
print("pose", await world("get_model_pose", { id: "milk_carton_1" }));
print("rejected", await world("get_model_pose", { id: "nobody" }));
print("malformed", await world("get_model_pose", { id: 7 }));
print("highlighted", await world("highlight_models", { id: "fridge", color: 2 }));
print("answers", await call("/mindstage/storage_place", "mindstage_msgs/Ask", { args: '{"item": "CowsMilk"}' }));

for (const compression of ["none", "png", "cbor"]) {
  const tf = new Topic({ ros, name: "/tf", messageType: "tf2_msgs/TFMessage", compression });
  print(`tf ${compression}`, await new Promise((resolve) => tf.subscribe(resolve)));
  tf.unsubscribe();
}
// roslibjs joins fragments, but cannot request them.
const subscription = { topic: "/tf", id: "pieces", fragment_size: 1000 };
const joined = new Promise((resolve) => ros.once("/tf", ({ msg }) => resolve(msg)));
ros.callOnConnection({ op: "subscribe", ...subscription });
print("tf fragments", await joined);
ros.callOnConnection({ op: "unsubscribe", ...subscription });

const markers = new Topic({ ros, name: "/unreal/markers", messageType: "visualization_msgs/MarkerArray" });
markers.publish({ markers: [{ ns: "page", id: 1, type: 2, color: { r: 1, g: 0, b: 0, a: 1 } }] });

// ROS 2: one goal that succeeds, one that is canceled after its second feedback.
const steps = new Action({ ros, name: "/unreal/simulate_steps", actionType: "simulation_interfaces/SimulateSteps" });
const sendGoal = (goal, onFeedback) =>
  new Promise((resolve) => {
    let id;
    const failed = (error) => resolve({ failed: error });
    id = steps.sendGoal(goal, (result) => resolve({ result }), (feedback) => onFeedback(feedback, () => steps.cancelGoal(id)), failed);
  });
print("succeeded", await sendGoal({ steps: 50 }, () => {}));
let feedbackCount = 0;
print("canceled", await sendGoal({ steps: 1e9 }, (_, cancel) => (feedbackCount += 1) === 2 && cancel()));

// ROS 1: the five topics of actionlib.
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
print("preempted", await preempted);
client.dispose();
ros.close();
