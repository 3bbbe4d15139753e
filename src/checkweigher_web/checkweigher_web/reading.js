// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// Large display of an item: mass, verdict as word and shape, age, and a scale that also shows the
// items before it. The content is one text in JSON, which the server makes once for all viewers.
const OLD = 10; // age in s from which a reading is grey
const SHAPES = {
  ACCEPT: "M12 2a10 10 0 1 0 0 20a10 10 0 1 0 0-20M7 12.5l3.5 3.5l6.5-7.5",
  UNDER: "M2 4h20L12 22z",
  OVER: "M2 20h20L12 2z",
  FAULT: "M8 2h8l6 6v8l-6 6H8l-6-6V8zM8 8l8 8M16 8l-8 8",
};

export default {
  template: `
    <div :class="['reading', shade]">
      <div class="said">
        <svg viewBox="0 0 24 24" aria-hidden="true"><path :d="shape"/></svg>
        <span class="decision">{{ item.decision ? (known ? item.word : texts.unknown) : texts.none }}</span>
        <span class="ago">{{ ago }}</span>
      </div>
      <div class="mass">{{ item.mass ?? '–' }}</div>
      <div class="scale" role="img" :aria-label="item.scale.label" v-if="item.scale">
        <div class="accepted" :style="{left: 100 * item.scale.accepted[0] + '%',
                                       right: 100 - 100 * item.scale.accepted[1] + '%'}"></div>
        <div v-for="[name, at, row] in item.scale.limits" :key="name" class="limit"
             :style="{left: 100 * at + '%', '--row': row}"><span>{{ name }}</span></div>
        <i v-for="([at, decision], place) in item.scale.dots" :key="place" :class="['dot', decision]"
           :style="{left: 100 * at + '%'}"></i>
        <i v-if="item.scale.at !== null" :class="['pointer', item.decision]"
           :style="{left: 100 * item.scale.at + '%'}"></i>
      </div>
      <div class="about">{{ item.about }}</div>
      <div class="why" v-if="item.why">{{ item.why }}</div>
    </div>`,
  // `age` in s, or -1 for a recorded item. `still` is true if the lane does not weigh.
  props: { text: { type: String, default: "{}" }, age: { type: Number, default: -1 },
           still: Boolean, texts: Object },
  data: () => ({ came: performance.now(), now: performance.now() }),
  watch: {
    text() {
      this.came = this.now = performance.now();
    },
  },
  computed: {
    item() {
      return JSON.parse(this.text);
    },
    known() {
      return this.item.decision in SHAPES;
    },
    shape() {
      return SHAPES[this.item.decision] ?? "M12 2a10 10 0 1 0 0 20a10 10 0 1 0 0-20";
    },
    seconds() {
      return this.age < 0 ? 0 : this.age + (this.now - this.came) / 1000;
    },
    ago() {
      if (this.age < 0 || !this.item.decision) return "";
      const s = Math.floor(this.seconds);
      return s < 120 ? this.texts.seconds.replace("{count}", s)
        : this.texts.minutes.replace("{count}", Math.floor(s / 60));
    },
    shade() {
      if (this.still || !this.item.decision) return "NONE";
      if (this.seconds > OLD) return "OLD";
      return this.known ? this.item.decision : "UNKNOWN";
    },
  },
  mounted() {
    this.timer = setInterval(() => { this.now = performance.now(); }, 1000);
  },
  beforeUnmount() {
    clearInterval(this.timer);
  },
};
