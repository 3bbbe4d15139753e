// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// The age of what the page shows. Without a beat of the server the browser itself greys the page.
const LATE = 3000; // ms, three periods of the server

export default {
  template: `<div class="late" role="alert">{{ text }}</div>`,
  props: { beat: Number, age: { type: Number, default: 0 } }, // s
  data: () => ({ came: performance.now(), text: "" }),
  watch: {
    beat() {
      this.came = performance.now() - 1000 * this.age;
      this.look();
    },
  },
  mounted() {
    this.timer = setInterval(this.look, LATE / 6);
  },
  beforeUnmount() {
    clearInterval(this.timer);
  },
  methods: {
    look() {
      const age = performance.now() - this.came;
      const since = new Date(Date.now() - age).toTimeString().slice(0, 8);
      const ago = `${Math.round(age / 1000)} s`;
      this.text = age > LATE ? `No news since ${since}, for ${ago}: what is below is old` : "";
      document.body.classList.toggle("stale", age > LATE);
    },
  },
};
