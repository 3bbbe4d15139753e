// Copyright 2026 Checkweigher maintainers
// SPDX-License-Identifier: Apache-2.0
// List of lines of text. The lines are one text in JSON, which the server makes.
export default {
  template: `<ol><li v-for="line in list">{{ line }}</li></ol>`,
  props: { lines: { type: String, default: "[]" } },
  computed: {
    list() {
      return JSON.parse(this.lines);
    },
  },
};
